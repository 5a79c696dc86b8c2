// The arithmetic of PPO, one number per sample: clipped objective, clipped value loss, exploration loss, and
// the standardisation of advantages. Every function keeps samples apart, so that a minibatch may be cut into
// micro-batches and still give the same gradient. Stage: update.
#pragma once

#include <torch/types.h>

#include <string>

#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/words.h"

namespace comrad::learn {

using torch::Tensor;

/// The ratio pi/mu is clamped to this before anything else.
constexpr double kRatioMin = 0.05, kRatioMax = 20.0;
/// An exploration loss above this counts as this and sends no gradient.
constexpr double kExplorationLossMax = 30.0;

/// exp(log pi - log mu), clamped to [0.05, 20].
Tensor importance_ratio(const Tensor& log_prob, const Tensor& behaviour_log_prob);

/// min(ratio A, clip(ratio, 1/(1+epsilon), 1+epsilon) A), to be maximised. Any shape.
/// Source: Schulman et al. 2017, arXiv:1707.06347, eq. 7, with the reciprocal lower bound of Sample Factory.
Tensor clipped_objective(const Tensor& ratio, const Tensor& advantage, double clip_ratio);

/// max((V-R)^2, (V_old + clamp(V-V_old, +-clip) - R)^2); the coefficient is the caller's.
Tensor clipped_value_loss(const Tensor& value, const Tensor& old_value, const Tensor& target,
                          double clip_value);

/// (A - mean) / max(std, 1e-7) over valid samples, unbiased; invalid ones become 0. A single valid sample
/// becomes 0.
///   advantage f32, valid u8 of the same shape
Tensor standardize(const Tensor& advantage, const Tensor& valid);

/// Loss per sample, to be minimised: symmetric KL to the uniform distribution over allowed choices, or
/// negative entropy, summed over heads. Capped at 30; non-finite counts as 0.
///   log_probs f32 [..., A] of policy::head_log_probs   mask u8 [..., A] or undefined   returns f32 [...]
Tensor exploration_loss(const Tensor& log_probs, const Tensor& mask, const EnvShape& env,
                        ExplorationLoss kind);

}  // namespace comrad::learn
