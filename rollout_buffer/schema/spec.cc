#include "rollout_buffer/schema/spec.h"

#include <spdlog/fmt/fmt.h>

#include <string>

namespace comrad {
namespace {

Status check_range(const char* name, int64_t value, int64_t low, int64_t high) {
  if (value >= low && value <= high) return {};
  return Error{ErrorCode::kBadInput, fmt::format("{} is {}; it must lie in {}..{}", name, value, low, high)};
}

}  // namespace

int32_t EnvShape::logit_count() const {
  int32_t sum = 0;
  for (int32_t head = 0; head < head_count; ++head) sum += head_sizes[head];
  return sum;
}

int64_t EnvShape::joint_action_count() const {
  int64_t product = 1;
  for (int32_t head = 0; head < head_count; ++head) product *= head_sizes[head];
  return product;
}

Status validate(const TrajectoryShape& shape) {
  const EnvShape& env = shape.env;
  COMRAD_TRY(check_range("num_agents", env.num_agents, 1, kMaxAgents));
  COMRAD_TRY(check_range("frame channels", env.channels, 1, 4));
  COMRAD_TRY(check_range("frame height", env.height, 1, 4096));
  COMRAD_TRY(check_range("frame width", env.width, 1, 4096));
  COMRAD_TRY(check_range("measurement count", env.measurement_count, 0, 1024));
  COMRAD_TRY(check_range("global state count", env.global_state_count, 0, 1024));
  COMRAD_TRY(check_range("action head count", env.head_count, 1, kMaxHeads));
  for (int32_t head = 0; head < env.head_count; ++head)
    COMRAD_TRY(check_range("action head size", env.head_sizes[head], 2, 32));
  COMRAD_TRY(check_range("rollout", shape.rollout_steps, 1, 4096));
  COMRAD_TRY(check_range("recurrent state size", shape.recurrent_state_count, 0, 1 << 16));
  COMRAD_TRY(check_range("recurrent snapshots", shape.recurrent_snapshots, 1, shape.rollout_steps + 1));
  COMRAD_TRY(check_range("final observations per slab", shape.final_capacity, 1, 64));
  return {};
}

}  // namespace comrad
