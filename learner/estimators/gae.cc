#include "learner/estimators/gae.h"

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

Advantages gae(const ReturnInput& input, const GaeOptions& options) {
  COMRAD_CHECK(input.reward.dim() == 2, "reward is [T, B]");
  const int64_t steps = input.reward.size(0), rows = input.reward.size(1);
  const float* reward = data_of<float>(input.reward, {steps, rows});
  const uint8_t* terminated = data_of<uint8_t>(input.terminated, {steps, rows});
  const uint8_t* truncated = data_of<uint8_t>(input.truncated, {steps, rows});
  const float* value = data_of<float>(input.value, {steps + 1, rows});
  const float* final_value = data_of<float>(input.final_value, {steps, rows});
  const uint8_t* valid = data_of<uint8_t>(input.valid, {steps, rows});
  const uint8_t* value_valid = data_of<uint8_t>(input.value_valid, {steps + 1, rows});

  Advantages result{torch::empty({steps, rows}), torch::empty({steps, rows})};
  float* advantage = result.advantage.data_ptr<float>();
  float* target = result.target.data_ptr<float>();
  // The recursion runs in double: 4096-step rollouts keep their last digits, and it costs nothing here.
  std::vector<double> carried(static_cast<std::size_t>(rows), 0.0);
  for (int64_t t = steps - 1; t >= 0; --t) {
    for (int64_t b = 0; b < rows; ++b) {
      const int64_t at = t * rows + b;
      const bool is_valid = valid[at] != 0;
      const bool done = terminated[at] != 0 || truncated[at] != 0;
      double delta = is_valid ? static_cast<double>(reward[at]) - value[at] : 0.0;
      if (!done && value_valid[at + rows] != 0) delta += options.gamma * value[at + rows];
      const bool bootstraps_final = truncated[at] != 0 && terminated[at] == 0 && !options.legacy_timeouts;
      if (is_valid && bootstraps_final) delta += options.gamma * final_value[at];
      double& running = carried[static_cast<std::size_t>(b)];
      const double factor = done ? 0.0 : is_valid ? options.gamma * options.lambda : 1.0;
      running = delta + factor * running;
      advantage[at] = static_cast<float>(running);
      target[at] = static_cast<float>(running + value[at]);
    }
  }
  return result;
}

}  // namespace comrad::learn
