#include "rollout_buffer/shm/step_slots.h"

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

StepSlots::StepSlots(const ArenaShape& shape, Region& region)
    : shape_(shape),
      slots_(region.take<StepSlot>(shape.env_count())),
      ready_(region.take<Doorbell>(shape.policy_worker_count)),
      acted_(region.take<Doorbell>(split_count())),
      rounds_(region.take<SplitRound>(split_count())),
      state_stride_(
          round_up(int64_t{shape.trajectory.env.num_agents} * shape.trajectory.recurrent_state_count,
                   kCacheLineBytes / sizeof(float))),
      states_(region.take<float>(int64_t{shape.env_count()} * 2 * state_stride_)) {}

StepSlot& StepSlots::slot(int env_index) const {
  return element(slots_, env_index, shape_.env_count(), "environment index is in range");
}

std::span<float> StepSlots::recurrent(int env_index, uint64_t parity) const {
  COMRAD_CHECK(env_index >= 0 && env_index < shape_.env_count(), "environment index is in range");
  const int64_t state = int64_t{env_index} * 2 + static_cast<int64_t>(parity & 1);
  return {states_ + state * state_stride_,
          static_cast<std::size_t>(shape_.trajectory.env.num_agents) *
              static_cast<std::size_t>(shape_.trajectory.recurrent_state_count)};
}

Doorbell& StepSlots::ready(int policy_worker) const {
  return element(ready_, policy_worker, shape_.policy_worker_count, "policy worker index is in range");
}

Doorbell& StepSlots::acted(int sim_worker, int split) const {
  COMRAD_CHECK(split >= 0 && split < shape_.splits_per_worker, "split is in range");
  return element(acted_, int64_t{sim_worker} * shape_.splits_per_worker + split, split_count(),
                 "simulator index is in range");
}

SplitRound& StepSlots::round(int sim_worker, int split) const {
  COMRAD_CHECK(split >= 0 && split < shape_.splits_per_worker, "split is in range");
  return element(rounds_, int64_t{sim_worker} * shape_.splits_per_worker + split, split_count(),
                 "simulator index is in range");
}

bool StepSlots::withdraw(int sim_worker) const {
  bool is_done = true;
  for (int local = 0; local < shape_.envs_per_worker; ++local) {
    StepSlot& orphan = slot(sim_worker * shape_.envs_per_worker + local);
    is_done &= advance(orphan, SlotState::kReady, SlotState::kIdle) ||
               advance(orphan, SlotState::kActed, SlotState::kIdle) ||
               orphan.state.load(std::memory_order_acquire) == SlotState::kIdle;
  }
  return is_done;
}

void StepSlots::idle(int sim_worker) const {
  for (int local = 0; local < shape_.envs_per_worker; ++local)
    slot(sim_worker * shape_.envs_per_worker + local)
        .state.store(SlotState::kIdle, std::memory_order_release);
  for (int split = 0; split < shape_.splits_per_worker; ++split)
    round(sim_worker, split).request_count.store(0, std::memory_order_release);
}

int StepSlots::requeue(int policy_worker) const {
  COMRAD_CHECK(policy_worker >= 0 && policy_worker < shape_.policy_worker_count,
               "policy worker index is in range");
  int returned = 0;
  for (int sim_worker = 0; sim_worker < shape_.sim_worker_count; ++sim_worker)
    for (int split = 0; split < shape_.splits_per_worker; ++split) {
      if (shape_.policy_worker_of(sim_worker, split) != policy_worker) continue;
      for (int local = shape_.split_begin(split); local < shape_.split_end(split); ++local)
        returned += advance(slot(sim_worker * shape_.envs_per_worker + local), SlotState::kInBatch,
                            SlotState::kReady);
    }
  if (returned > 0) ring(ready(policy_worker));
  return returned;
}

}  // namespace comrad::shm
