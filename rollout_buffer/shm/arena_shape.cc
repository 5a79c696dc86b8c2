#include "rollout_buffer/shm/arena_shape.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>

namespace comrad::shm {
namespace {

Status check_range(const char* name, int64_t value, int64_t low, int64_t high) {
  if (value >= low && value <= high) return {};
  return Error{ErrorCode::kBadInput,
               fmt::format("arena: {} is {}; it must lie in {}..{}", name, value, low, high)};
}

}  // namespace

Status validate(const ArenaShape& shape) {
  COMRAD_TRY(comrad::validate(shape.trajectory));
  COMRAD_TRY(check_range("sim_worker_count", shape.sim_worker_count, 1, 1024));
  COMRAD_TRY(check_range("envs_per_worker", shape.envs_per_worker, 1, 1024));
  COMRAD_TRY(
      check_range("splits_per_worker", shape.splits_per_worker, 1, std::min(2, shape.envs_per_worker)));
  COMRAD_TRY(check_range("policy_worker_count", shape.policy_worker_count, 1, 256));
  COMRAD_TRY(check_range("slab_count", shape.slab_count, 1, 1 << 20));
  COMRAD_TRY(check_range("journal_steps", shape.journal_steps, 0, 1 << 20));
  COMRAD_TRY(check_range("episode_ring_capacity", shape.episode_ring_capacity, 1, 1 << 20));
  COMRAD_TRY(check_range("remote_worker_count", shape.remote_worker_count, 0, shape.sim_worker_count));
  COMRAD_TRY(check_range("remote_frame_worker_count", shape.remote_frame_worker_count, 0,
                         shape.remote_worker_count));
  COMRAD_TRY(check_range("weights_bytes", shape.weights_bytes, 0, int64_t{1} << 36));
  return {};
}

}  // namespace comrad::shm
