// PPO's loss, and its arithmetic, one number per sample. Every function keeps samples apart, so that a minibatch may be cut into
// micro-batches and still give the same gradient.
//
//   ratio  = clamp(exp(log pi - log mu), 0.05, 20)
//   loss   = - mean min(ratio A, clip(ratio, 1/(1+eps), 1+eps) A)             eps = ppo_clip_ratio
//            + exploration_loss_coeff mean exploration(pi) + kl_loss_coeff mean KL(pi, mu)          policy_loss()
//            + value_loss_coeff mean max((V-R)^2, (V_old + clamp(V-V_old, +-ppo_clip_value) - R)^2)    value_loss()
//
// exploration being the symmetric KL to the uniform distribution or the negative entropy; V and R in normalised units. The value's
// mean runs over valid samples, the others over those of them in which the agent was alive (RolloutBatch::acting): a dead agent's
// actions teach nothing, but its values continue being trained, because GAE carries what is paid after a death through them to the
// last living decision. Source: Schulman et al. 2017, arXiv:1707.06347, eqs. 7 and 9. Stage: update.
#pragma once

#include <torch/types.h>

#include <span>
#include <string>

#include "learner/batch/collate.h"
#include "learner/losses/loss_terms.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/words.h"

namespace comrad::learn {

/// The ratio pi/mu is clamped to this before anything else.
constexpr double kRatioMin = 0.05, kRatioMax = 20.0;
/// An exploration loss above this counts as this and sends no gradient.
constexpr double kExplorationLossMax = 30.0;

/// exp(log pi - log mu), clamped to [0.05, 20].
Tensor importance_ratio(const Tensor& log_prob, const Tensor& behaviour_log_prob);

/// The clip interval of the ratio, f32 [] each, where `clip_ratio` lies.
struct ClipInterval {
  Tensor low, high;  ///< 1/(1+epsilon), 1+epsilon
  /// `clip_ratio` f64 []: epsilon.
  static ClipInterval of(const Tensor& clip_ratio);
};

/// min(ratio A, clip(ratio, 1/(1+epsilon), 1+epsilon) A), to be maximised. Any shape.
/// Source: Schulman et al. 2017, arXiv:1707.06347, eq. 7, with the reciprocal lower bound of Sample Factory.
Tensor clipped_objective(const Tensor& ratio, const Tensor& advantage, const ClipInterval& clip);

/// max((V-R)^2, (V_old + clamp(V-V_old, +-clip) - R)^2); the coefficient is the caller's.
Tensor clipped_value_loss(const Tensor& value, const Tensor& old_value, const Tensor& target,
                          double clip_value);

/// (A - mean) / max(std, floor, 1e-7) over valid samples, unbiased; invalid ones become 0. A single valid sample
/// becomes 0. Without a floor, advantages that hold nothing but the critic's noise are blown up to unit size.
///   advantage f32, valid u8 of the same shape, floor in units of the advantage
Tensor standardize(const Tensor& advantage, const Tensor& valid, double floor = 0);

/// Loss per sample, to be minimised: symmetric KL to the uniform distribution over allowed choices, or
/// negative entropy, summed over heads. Capped at 30; non-finite counts as 0.
///   log_probs f32 [..., A] of policy::head_log_probs   mask u8 [..., A] or undefined   returns f32 [...]
Tensor exploration_loss(const Tensor& log_probs, const Tensor& mask, const EnvShape& env,
                        ExplorationLoss kind);

struct PpoOptions {
  double clip_value = 0.2;  ///< largest step of the value, in its unit
  double value_coeff = 0.5, kl_coeff = 0;
  ExplorationLoss exploration = ExplorationLoss::kNone;
  static PpoOptions from(const RunConfig& config);
};

/// What a step's losses read beside its rows: of the whole minibatch, and of this moment of the run. f64 [] each.
struct PpoScalars {
  Tensor valid_count, acting_count;      ///< samples that means divide by, at least 1
  Tensor clip_ratio, exploration_coeff;  ///< settings that may follow a schedule
  /// Of a step's scalars in this order, as the step runner has them.
  explicit PpoScalars(std::span<const Tensor> scalars);
};

/// Adds the loss of a policy with `logits` f32 [T, R, A] over the rows of a micro-batch, and what reports show of it.
/// LossTerms::kept becomes log pi(a|o).
void add_policy_loss(LossTerms& terms, const Tensor& logits, const RolloutBatch& rows,
                     const PpoScalars& scalars, const PpoOptions& options);
/// The same of values f32 [T, R], an agent's own or a central critic's.
void add_value_loss(LossTerms& terms, const Tensor& value, const RolloutBatch& rows,
                    const PpoScalars& scalars, const PpoOptions& options);
/// Both, of what `output` has.
LossTerms ppo_loss(const policy::SequenceOutput& output, const RolloutBatch& rows, const PpoScalars& scalars,
                   const PpoOptions& options);

}  // namespace comrad::learn
