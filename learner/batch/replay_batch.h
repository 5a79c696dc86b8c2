// What Q-learning trains on: sequences or single decisions drawn from the replay, as tensors. One form
// serves both, a single decision being a sequence of T = 1. Stage: sample > minibatch.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <span>
#include <vector>

#include "learner/batch/collate.h"
#include "rollout_buffer/replay/replay.h"

namespace comrad::learn {

/// W worlds of T steps; R = W * N rows, row = world * N + agent. A world is a sequence (T = rollout), one
/// joint decision (T = 1), or one agent's decision (T = 1, N = 1).
///
/// The observation behind step t is row t + 1, except where the episode was cut by time: its true last
/// observation is one of the F final rows, N neighbours for each cut. Single decisions have no final rows;
/// there row 1 is the true next observation, n decisions on where n_step is n. Steps behind the end of a
/// short trajectory and steps that a peer broke are not valid.
struct ReplayBatch {
  TrajectoryShape shape;  ///< rollout_steps = T and env.num_agents = N of this batch
  int64_t world_count = 0;
  bool has_action_mask = false;

  Tensor frame;            ///< u8  [T+1, R, C, H, W]
  Tensor measurement;      ///< f32 [T+1, R, M], undefined when M = 0
  Tensor global_state;     ///< f32 [T+1, W, S] of the worlds, undefined when S = 0
  Tensor action_mask;      ///< u8  [T+1, R, A]
  Tensor agent_active;     ///< u8  [T+1, R]
  Tensor action;           ///< i64 [T, R, heads]
  Tensor reward;           ///< f32 [T, R]  of single decisions the sum of n discounted ones
  Tensor bootstrap;        ///< f32 [T, R]  gamma^(n-1): what else the value behind is multiplied by
  Tensor terminated;       ///< u8  [T, R]  with agents_end also the last decision of an agent
  Tensor truncated;        ///< u8  [T, R]
  Tensor valid;            ///< u8  [T, R]
  Tensor reset;            ///< u8  [T+1, R] state is zeroed before this step
  Tensor recurrent_state;  ///< f32 [R, H] before step 0
  Tensor weight;           ///< f32 [W]  importance weights

  Tensor final_frame;               ///< u8  [F, C, H, W]
  Tensor final_measurement;         ///< f32 [F, M], undefined when M = 0
  Tensor final_global_state;        ///< f32 [F / N, S], of each cut; undefined when S = 0
  std::vector<int64_t> final_step;  ///< [F] the step that it follows
  std::vector<int64_t> final_row;   ///< [F] ascending

  /// Of several learners' replays: that of the unit which is drawn least often from the one these worlds came from, and
  /// what a probability is raised to in a weight.
  double least_probability = 0, weight_exponent = 1;

  std::vector<int64_t> serial;  ///< [W] the replay's handles, for priorities
  Tensor abs_td;                ///< f32 [W] made by the algorithm, see QLearning

  device::Event was_read;  ///< made by hand_back()

  int64_t rewards_read = 0;     ///< payments that the rewards are made of
  int64_t rewards_clipped = 0;  ///< of those, changed by reward_clip

  int64_t steps() const { return shape.rollout_steps; }
  int64_t rows() const { return world_count * shape.env.num_agents; }
};

/// How draws become a batch.
struct ReplayBatchOptions {
  TrajectoryShape shape;  ///< of the stored trajectories
  replay::Unit unit = replay::Unit::kSequence;
  int64_t world_count = 1;
  int64_t n_step = 1;  ///< single decisions
  replay::PostDeathReward pay =
      {};  ///< discount inside the rewards of single decisions, and the clip of each payment
  /// Agents learn each on its own: where one leaves the game while the world continues, its last decision is
  /// terminated and paid what follows (see post_death_reward.h). Off: a team is paid, and continues without it.
  bool agents_end = false;
  torch::Device device = torch::kCPU;  ///< that copies the frames while the host continues
};

/// Allocates; reuse it.
ReplayBatch make_replay_batch(const ReplayBatchOptions& options);

/// What `device` was given so far may read the batch later than its learner returns from the update. Threads: the learner's.
void hand_back(ReplayBatch& batch, torch::Device device);
/// Copies `draws` (world_count of them) out of the replay, once the device has read what was there. A trajectory that was evicted
/// meanwhile leaves a world without valid steps.
void fill(ReplayBatch& batch, const ReplayBatchOptions& options, const replay::Replay& replay,
          std::span<const replay::Draw> draws);

/// The worlds [begin, begin + count) of a batch as views; final rows are copied.
ReplayBatch narrow_worlds(const ReplayBatch& batch, int64_t begin, int64_t count);

/// The steps from `first` on as views, with the state that stands before them; cuts before it are left out.
ReplayBatch steps_from(const ReplayBatch& batch, int64_t first, const Tensor& recurrent_state);

}  // namespace comrad::learn
