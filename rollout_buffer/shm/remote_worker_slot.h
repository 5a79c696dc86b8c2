// Which simulators of other hosts play in this arena, and how far each of their environments has come: one slot for each
// remote worker, the last of the arena's sim workers.
//
//   RemoteWorkerSlot [remote worker] | RemoteEnvironment [remote worker, local env]
//
// Writer: the receiver that serves the slot; while it is dead, the supervisor. A receiver that is restarted resumes here.
#pragma once

#include <atomic>
#include <cstdint>

#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

struct alignas(kCacheLineBytes) RemoteWorkerSlot {
  std::atomic<uint64_t>
      sender_id;  ///< id of the host that plays here; 0: free. Stored last when a host takes the slot
};
static_assert(sizeof(RemoteWorkerSlot) == kCacheLineBytes, "changing this bumps kArenaVersion");

/// Rollouts are counted by the arena, from one host to the next, and by each host from 0; an offset leads from one to the
/// other.
struct RemoteEnvironment {
  uint64_t rollout_index;        ///< the arena's count: of the trajectory that comes next
  uint64_t rollout_offset;       ///< the arena's count minus the present host's, modulo 2^64
  uint64_t steps_sealed_before;  ///< for hosts before the present one
  uint32_t has_offset;           ///< 1 once the present host's first trajectory has come
  uint32_t unused;
};
static_assert(sizeof(RemoteEnvironment) == 32, "changing this bumps kArenaVersion");

class RemoteWorkerSlots {
 public:
  RemoteWorkerSlots(const ArenaShape& shape, Region& region);

  RemoteWorkerSlot& slot(int sim_worker) const;  ///< by its index among all sim workers
  RemoteEnvironment& environment(int env_index) const;

 private:
  const ArenaShape shape_;
  RemoteWorkerSlot* const slots_;
  RemoteEnvironment* const environments_;
};

}  // namespace comrad::shm
