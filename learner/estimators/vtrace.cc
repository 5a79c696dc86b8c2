#include "learner/estimators/vtrace.h"

#include "learner/estimators/step_rows.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {

Advantages vtrace(const Tensor& log_rho_tensor, const ReturnInput& input, const VtraceOptions& options) {
  COMRAD_CHECK(input.reward.dim() == 2, "reward is [T, B]");
  const int64_t steps = input.reward.size(0), columns = input.reward.size(1);
  const auto log_rho = step_rows<float>(log_rho_tensor, steps, columns);
  const auto reward = step_rows<float>(input.reward, steps, columns);
  const auto terminated = step_rows<uint8_t>(input.terminated, steps, columns);
  const auto truncated = step_rows<uint8_t>(input.truncated, steps, columns);
  const auto value = step_rows<float>(input.value, steps + 1, columns);
  const auto final_value = step_rows<float>(input.final_value, steps, columns);

  Advantages result{torch::empty({steps, columns}), torch::empty({steps, columns})};
  auto advantage = step_rows<float>(result.advantage, steps, columns);
  auto target = step_rows<float>(result.target, steps, columns);
  StepRow next_target = value.row(steps).cast<double>();  // vs_{t+1}
  for (int64_t t = steps - 1; t >= 0; --t) {
    const StepRow ratio = log_rho.row(t).cast<double>().exp();
    const StepRow rho = ratio.min(options.rho_clip), c = ratio.min(options.c_clip);
    const auto [done, bootstraps] = step_ends(terminated, truncated, t, options.legacy_timeouts);
    const StepRow pay = reward.row(t).cast<double>(), now = value.row(t).cast<double>(),
                  next = value.row(t + 1).cast<double>();
    const StepRow at_end = bootstraps.select(final_value.row(t).cast<double>(), 0.0);
    const StepRow delta = rho * (pay + options.gamma * done.select(at_end, next) - now);
    advantage.row(t) = (rho * (pay + options.gamma * done.select(at_end, next_target) - now)).cast<float>();
    next_target = now + delta + done.select(StepRow::Zero(columns), options.gamma * c * (next_target - next));
    target.row(t) = next_target.cast<float>();
  }
  return result;
}

}  // namespace comrad::learn
