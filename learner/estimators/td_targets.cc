#include "learner/estimators/td_targets.h"

#include <algorithm>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {

Tensor td_targets(const TdInput& input, const TdOptions& options) {
  COMRAD_CHECK(input.reward.dim() == 2 && input.reward.size(0) >= 1, "reward is [T, B]");
  COMRAD_CHECK(options.n_step >= 1, "a target has a reward");
  COMRAD_CHECK(options.lambda <= 1, "lambda lies within 0..1 or is negative");
  const at::IntArrayRef shape = input.reward.sizes();
  for (const Tensor* tensor : {&input.terminated, &input.truncated, &input.next_value, &input.valid})
    COMRAD_CHECK(tensor->defined() && tensor->sizes() == shape, "estimator input has the batch's shape");
  torch::NoGradGuard no_grad;
  // Whole rows at a time and in double: a sequence is 32 steps long, so this is a few dozen small operators
  // on whatever device the values were computed on, and long returns keep their last digits.
  const int64_t steps = shape[0];
  const Tensor valid = input.valid.ne(0);
  const Tensor truncated = input.truncated.ne(0);
  Tensor terminated = input.terminated.ne(0);
  if (options.legacy_timeouts) terminated = terminated.logical_or(truncated);
  const Tensor zero = torch::zeros({}, input.reward.options().dtype(torch::kFloat64));
  const Tensor reward = at::where(valid, input.reward.to(torch::kFloat64), zero);
  const Tensor value =
      at::where(valid.logical_not().logical_or(terminated), zero, input.next_value.to(torch::kFloat64));
  const Tensor end = reward + options.gamma * value;
  // Whether the return of step t may use step t + 1, for t < T - 1.
  const Tensor goes_on =
      valid.slice(0, 1)
          .logical_and(valid.slice(0, 0, steps - 1))
          .logical_and(terminated.logical_or(truncated).logical_not().slice(0, 0, steps - 1));

  Tensor target = end;
  if (options.lambda >= 0) {
    target = end.clone();
    for (int64_t t = steps - 2; t >= 0; --t) {
      const Tensor mixed = at::lerp(value[t], target[t + 1], options.lambda);
      target[t].copy_(at::where(goes_on[t], reward[t] + options.gamma * mixed, end[t]));
    }
  } else {
    // The m-step return is a reward and the (m-1)-step return of the next step.
    for (int64_t m = 2; m <= std::min(options.n_step, steps); ++m) {
      const Tensor longer = reward.slice(0, 0, steps - 1) + options.gamma * target.slice(0, 1);
      target = at::cat({at::where(goes_on, longer, end.slice(0, 0, steps - 1)), end.slice(0, steps - 1)}, 0);
    }
  }
  return target.to(torch::kFloat32);
}

Tensor huber(const Tensor& error) {
  const Tensor size = error.abs();
  const Tensor inside = size.clamp_max(1.0);
  return inside * (size - 0.5 * inside);
}

}  // namespace comrad::learn
