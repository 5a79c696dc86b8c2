#include "learner/estimators/vtrace.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

template <typename T>
const T* data_of(const Tensor& tensor, at::IntArrayRef shape) {
  COMRAD_CHECK(tensor.defined() && tensor.sizes() == shape, "estimator input has the batch's shape");
  COMRAD_CHECK(tensor.is_contiguous() && tensor.device().is_cpu(),
               "estimator input is contiguous on the CPU");
  return tensor.data_ptr<T>();
}

}  // namespace

Advantages vtrace(const Tensor& log_rho_tensor, const ReturnInput& input, const VtraceOptions& options) {
  COMRAD_CHECK(input.reward.dim() == 2, "reward is [T, B]");
  const int64_t steps = input.reward.size(0), rows = input.reward.size(1);
  const float* log_rho = data_of<float>(log_rho_tensor, {steps, rows});
  const float* reward = data_of<float>(input.reward, {steps, rows});
  const uint8_t* terminated = data_of<uint8_t>(input.terminated, {steps, rows});
  const uint8_t* truncated = data_of<uint8_t>(input.truncated, {steps, rows});
  const float* value = data_of<float>(input.value, {steps + 1, rows});
  const float* final_value = data_of<float>(input.final_value, {steps, rows});

  Advantages result{torch::empty({steps, rows}), torch::empty({steps, rows})};
  float* advantage = result.advantage.data_ptr<float>();
  float* target = result.target.data_ptr<float>();
  std::vector<double> next_target(static_cast<std::size_t>(rows));  // vs_{t+1}
  for (int64_t b = 0; b < rows; ++b) next_target[static_cast<std::size_t>(b)] = value[steps * rows + b];
  for (int64_t t = steps - 1; t >= 0; --t) {
    for (int64_t b = 0; b < rows; ++b) {
      const int64_t at = t * rows + b;
      const double ratio = std::exp(static_cast<double>(log_rho[at]));
      const double rho = std::min(ratio, options.rho_clip), c = std::min(ratio, options.c_clip);
      const bool cut = truncated[at] != 0 && !options.legacy_timeouts;
      const bool done = terminated[at] != 0 || truncated[at] != 0;
      double& vs_next = next_target[static_cast<std::size_t>(b)];
      const double v = value[at], v_next = value[at + rows];
      const double at_end = cut && terminated[at] == 0 ? static_cast<double>(final_value[at]) : 0.0;
      const double delta = rho * (reward[at] + options.gamma * (done ? at_end : v_next) - v);
      advantage[at] = static_cast<float>(rho * (reward[at] + options.gamma * (done ? at_end : vs_next) - v));
      vs_next = v + delta + (done ? 0.0 : options.gamma * c * (vs_next - v_next));
      target[at] = static_cast<float>(vs_next);
    }
  }
  return result;
}

}  // namespace comrad::learn
