// From the Q-values of factorised heads to the utility of an agent: heads are summed, so the best compound
// action is each head's best choice and nobody enumerates the |A| joint choices. Masks count in every argmax.
// Serves update: what mixers and temporal-difference targets are made from.
#pragma once

#include <torch/types.h>

#include "rollout_buffer/schema/spec.h"

namespace comrad::learn {

using torch::Tensor;

/// Q_h(a_h) of every head.
///   q       [..., A]      f32  Q-values, heads side by side
///   action  [..., heads]  i64  choices counted from each head's own 0
///   returns [..., heads]  f32, differentiable in q
Tensor chosen_values(const Tensor& q, const Tensor& action, const EnvShape& env);

/// Q_i(a) = sum_h Q_h(a_h); arguments as above. Returns [...]. Source: training spec 1.6.
Tensor chosen_utility(const Tensor& q, const Tensor& action, const EnvShape& env);

/// argmax_a Q_i(a), which is each head's argmax; of equal values the first, as sample_action takes it.
///   mask    [..., A]      u8   1 = allowed; undefined: everything is. A masked choice is never taken; a head
///                              without any allowed choice counts as unmasked (a dead agent's all-zero mask).
///   returns [..., heads]  i64
Tensor greedy_action(const Tensor& q, const Tensor& mask, const EnvShape& env);

/// max_a Q_i(a) over allowed choices. Returns [...] f32, differentiable in q.
Tensor greedy_utility(const Tensor& q, const Tensor& mask, const EnvShape& env);

/// One-hot vectors of all heads side by side: [..., heads] i64 -> [..., A] f32 on the action's device.
Tensor multi_hot(const Tensor& action, const EnvShape& env);

}  // namespace comrad::learn
