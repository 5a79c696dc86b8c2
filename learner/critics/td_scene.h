// What the online and the target network make of a part of a replay's batch: Q-values of the observations that were decided on and of
// the true ones behind them. Where time cut an episode that is its own last one, with the recurrent state that led there, and never the
// first of the next episode. Stage: update.
#pragma once

#include <torch/types.h>

#include <functional>
#include <vector>

#include "learner/batch/replay_batch.h"
#include "policy_workers/network/actor_critic.h"

namespace comrad::learn {

using torch::Tensor;

/// Some worlds of a batch, on the device.
struct ReplayPart {
  ReplayBatch batch;   ///< of the steps that are trained
  ReplayBatch before;  ///< with a burn-in: observations and resets of the steps that warm up the state
  Tensor final_row, final_step;  ///< i64 [F]: batch.final_row, batch.final_step

  /// All tensors that are defined.
  void visit(const std::function<void(Tensor&)>& visit);
};

/// `batch` in parts of so many worlds, on `device`. `rounds_cuts`: repeats cut episodes up to a power of two, so that few recordings
/// of a GPU's work fit all batches.
std::vector<ReplayPart> replay_parts(const ReplayBatch& batch, int64_t worlds, int64_t burn_in,
                                     bool rounds_cuts, torch::Device device);

/// What one network makes of a micro-batch.
struct QValues {
  Tensor now;         ///< f32 [T, R, A]  of the observations that were decided on; undefined for a target
                      ///<                without a recurrent core
  Tensor next;        ///< f32 [T, R, A]  of the true observations behind them; no gradient
  Tensor state;       ///< f32 [T, R, E]  encoder features of the former; detached; undefined as `now`
  Tensor next_state;  ///< f32 [T, R, E]  encoder features of the latter; detached
};
/// A micro-batch on the device, what lies behind its steps, and what both networks make of it.
struct TdScene {
  ReplayBatch batch;
  Tensor next_mask;    ///< u8 [T, R, A]; undefined when everything was allowed
  Tensor next_active;  ///< u8 [T, R]
  Tensor state,
      next_state;  ///< f32 [T, W, S] the worlds' true states, normalised; undefined where mixers see none
  QValues online, target;
  Tensor sigma;         ///< f64 []: what Q-values are multiplied by to be in natural units
  Tensor mask() const;  ///< of the observations that were decided on; undefined as above
};

/// Both networks over a part; with gradient in the online one. `sigma` stays undefined.
TdScene td_scene(const policy::ActorCritic& online, const policy::ActorCritic& target,
                 const ReplayPart& part);

}  // namespace comrad::learn
