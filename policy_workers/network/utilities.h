// From the Q-values of factorised heads to the utility of an agent: heads are summed, so the best compound
// action is each head's best choice without enumerating the |A| joint choices. Masks count in every argmax.
// Serves forward and update.
#pragma once

#include <torch/types.h>

#include "rollout_buffer/schema/spec.h"

namespace comrad::policy {

using torch::Tensor;

/// Q_i(a) = sum_h Q_h(a_h). q [..., A] f32, action [..., heads] i64 counted from each head's own 0.
/// Returns [...], differentiable in q.
Tensor chosen_utility(const Tensor& q, const Tensor& action, const EnvShape& env);

/// argmax_a Q_i(a), which is each head's argmax; of equal values the first, as sample_action takes it.
///   mask    [..., A]      u8   1 = allowed; undefined: everything is. A masked choice is never taken.
///   returns [..., heads]  i64
Tensor greedy_action(const Tensor& q, const Tensor& mask, const EnvShape& env);

/// max_a Q_i(a) over allowed choices. Returns [...] f32, differentiable in q.
Tensor greedy_utility(const Tensor& q, const Tensor& mask, const EnvShape& env);

}  // namespace comrad::policy
