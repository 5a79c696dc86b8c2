#include "policy_workers/batching/recurrent_state_table.h"

#include <algorithm>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::policy {

RecurrentStateTable::RecurrentStateTable(const shm::Arena& arena)
    : arena_(&arena), state_count_(arena.shape().trajectory.recurrent_state_count) {}

void RecurrentStateTable::load(int env_index, uint64_t step_id, bool reset, std::span<float> out) const {
  if (reset) {
    std::ranges::fill(out, 0.0f);
    return;
  }
  const std::span<float> stored = arena_->step_slots().recurrent(env_index, step_id & 1);
  COMRAD_DCHECK(stored.size() == out.size(), "a state is [N, H]");
  std::ranges::copy(stored, out.begin());
}

void RecurrentStateTable::store(int env_index, uint64_t step_id, std::span<const float> in) const {
  const std::span<float> stored = arena_->step_slots().recurrent(env_index, (step_id + 1) & 1);
  COMRAD_DCHECK(stored.size() == in.size(), "a state is [N, H]");
  std::ranges::copy(in, stored.begin());
}

}  // namespace comrad::policy
