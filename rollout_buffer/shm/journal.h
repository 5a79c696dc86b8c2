// What a restarted simulator counts on from, and what exact resume replays: one journal for each environment.
//
//   JournalHeader [env] | joint actions since reset [env, journal_steps, N * heads] u8
//
// Writer: the simulator; before it starts, a learner that resumes in lock step; while it is dead, the supervisor.
#pragma once

#include <cstdint>
#include <span>

#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

/// What exact resume needs of one environment (deterministic mode): replaying the actions from `episode_seed`
/// gives its world back; the recurrent state lies beside the step slots.
struct JournalHeader {
  uint64_t episode_seed;
  uint64_t episode_id;
  uint64_t step_id;
  uint64_t rollout_index;
  uint32_t
      length;  ///< decisions since reset; more than journal_steps: the journal overflowed, no exact resume
  uint32_t is_resume;  ///< 1: written by the learner before start; the simulator replays it first
  uint32_t in_use;  ///< 1 once the environment has begun; a restarted simulator counts its ids on from here
};
static_assert(sizeof(JournalHeader) == 48, "changing this bumps kArenaVersion");

class Journals {
 public:
  Journals(const ArenaShape& shape, Region& region);

  JournalHeader& header(int env_index) const;
  std::span<uint8_t> action(int env_index, int step) const;  ///< [N * heads]

 private:
  const int64_t env_count_, step_count_, row_bytes_;
  JournalHeader* const headers_;
  uint8_t* const actions_;
};

}  // namespace comrad::shm
