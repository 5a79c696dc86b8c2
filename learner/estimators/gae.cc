#include "learner/estimators/gae.h"

#include "learner/estimators/step_rows.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {

Advantages gae(const ReturnInput& input, const GaeOptions& options) {
  COMRAD_CHECK(input.reward.dim() == 2, "reward is [T, B]");
  const int64_t steps = input.reward.size(0), columns = input.reward.size(1);
  const auto reward = step_rows<float>(input.reward, steps, columns);
  const auto terminated = step_rows<uint8_t>(input.terminated, steps, columns);
  const auto truncated = step_rows<uint8_t>(input.truncated, steps, columns);
  const auto value = step_rows<float>(input.value, steps + 1, columns);
  const auto final_value = step_rows<float>(input.final_value, steps, columns);
  const auto valid = step_rows<uint8_t>(input.valid, steps, columns);
  const auto value_valid = step_rows<uint8_t>(input.value_valid, steps + 1, columns);

  Advantages result{torch::empty({steps, columns}), torch::empty({steps, columns})};
  auto advantage = step_rows<float>(result.advantage, steps, columns);
  auto target = step_rows<float>(result.target, steps, columns);
  // Values that must not count are left out by select(), not by a factor of 0: they may be anything.
  StepRow carried = StepRow::Zero(columns);  // A_{t+1}
  for (int64_t t = steps - 1; t >= 0; --t) {
    const auto [done, bootstraps] = step_ends(terminated, truncated, t, options.legacy_timeouts);
    const StepMask is_valid = valid.row(t) != 0, has_final = is_valid && bootstraps;
    const StepMask has_next = !done && value_valid.row(t + 1) != 0;
    const StepRow now = value.row(t).cast<double>();
    const StepRow delta = is_valid.select(reward.row(t).cast<double>() - now, 0.0) +
                          options.gamma * has_next.select(value.row(t + 1).cast<double>(), 0.0) +
                          options.gamma * has_final.select(final_value.row(t).cast<double>(), 0.0);
    const StepRow factor =
        done.select(StepRow::Zero(columns),
                    is_valid.select(StepRow::Constant(columns, options.gamma * options.lambda), 1.0));
    carried = delta + factor * carried;
    advantage.row(t) = carried.cast<float>();
    target.row(t) = (carried + now).cast<float>();
  }
  return result;
}

}  // namespace comrad::learn
