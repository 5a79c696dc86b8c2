// What became of every step that was played: one account for each environment.
//
//   EnvAccount [env]
//
// Each word names its writer; the sums hold whatever moment kills a process.
#pragma once

#include <atomic>
#include <cstdint>

#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

/// What became of the steps (decisions of all agents) that one environment has played since the arena was made:
///
///   made = sealed + in the slab in hand + lost         sealed = taken + in sealed slabs
///
/// Each word alone is the truth about what it counts, so that a process killed between any two stores leaves sums that
/// add up: `made` and `sealed` are stored before what they announce, and reclaim_sim_worker() takes back what was announced
/// and not done.
struct alignas(kCacheLineBytes) EnvAccount {
  // Simulator; while it is dead, the supervisor.
  std::atomic<uint64_t> made;
  std::atomic<uint64_t> sealed;  ///< in slabs that were sealed
  // Supervisor.
  std::atomic<uint64_t> lost;  ///< in slabs that dead simulators left half full
  // Learners; while they are dead, the supervisor. It only grows.
  alignas(kCacheLineBytes) std::atomic<uint64_t> taken;  ///< in slabs that were drained
};
static_assert(sizeof(EnvAccount) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// The accounts of all environments together, in agent decisions.
struct DecisionCounts {
  uint64_t made = 0;
  uint64_t sealed = 0;
  uint64_t taken = 0;
  uint64_t lost = 0;
};

class Accounts {
 public:
  Accounts(const ArenaShape& shape, Region& region);

  EnvAccount& of(int env_index) const;
  /// While processes are at work: made >= sealed + lost, sealed >= taken.
  DecisionCounts counts() const;
  /// Supervisor: whatever a dead simulator made and did not seal is lost. What another host made it sends again, so that is
  /// not counted as made. Returns agent decisions lost.
  uint64_t write_off(int sim_worker) const;

 private:
  const ArenaShape shape_;
  EnvAccount* const accounts_;
};

}  // namespace comrad::shm
