#include "rollout_buffer/shm/journal.h"

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

Journals::Journals(const ArenaShape& shape, Region& region)
    : env_count_(shape.env_count()),
      step_count_(shape.journal_steps),
      row_bytes_(int64_t{shape.trajectory.env.num_agents} * shape.trajectory.env.head_count),
      headers_(region.take<JournalHeader>(env_count_)),
      actions_(region.take<uint8_t>(env_count_ * step_count_ * row_bytes_)) {}

JournalHeader& Journals::header(int env_index) const {
  return element(headers_, env_index, env_count_, "environment index is in range");
}

std::span<uint8_t> Journals::action(int env_index, int step) const {
  COMRAD_CHECK(env_index >= 0 && env_index < env_count_, "environment index is in range");
  COMRAD_CHECK(step >= 0 && step < step_count_, "journal step is in range");
  return {actions_ + (env_index * step_count_ + step) * row_bytes_, static_cast<std::size_t>(row_bytes_)};
}

}  // namespace comrad::shm
