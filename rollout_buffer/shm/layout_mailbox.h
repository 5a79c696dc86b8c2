// Where each environment's maps come from while it trains on a pool of layouts.
//
//   LayoutMailbox [env]
//
// Writers: the simulator takes its assignments, the learner's curriculum (on other hosts the trajectory sender) gives them.
// How the episodes ended is in the episode stream (episode_stream.h).
#pragma once

#include <atomic>
#include <cstdint>

#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

/// Neither side waits: a simulator whose draw is due while no new assignment lies there plays its layout once more.
///
///   simulator  assigned != taken: playing = layout_index, taken = assigned
///   learner    assigned == taken: layout_index = a draw, ++assigned
struct alignas(kCacheLineBytes) LayoutMailbox {
  // Simulator.
  std::atomic<uint32_t> taken;    ///< assignments taken so far
  std::atomic<uint32_t> playing;  ///< layout of the present episode, by its index in the pool
  std::atomic<uint32_t> late;     ///< draws that were due while no new assignment lay there
  // Learner.
  alignas(kCacheLineBytes) std::atomic<uint32_t> assigned;  ///< assignments given so far
  std::atomic<uint32_t> layout_index;                       ///< of the newest assignment, in the pool

  /// Simulator: plays the newest assignment from now on; where there is none, counts the draw as late.
  void take_assignment();
  /// Learner: the last assignment was taken, another one is due.
  bool is_due() const {
    return taken.load(std::memory_order_acquire) == assigned.load(std::memory_order_relaxed);
  }
  /// Learner: a new assignment, where one is due.
  void assign(uint32_t layout_index_of_pool);
};
static_assert(sizeof(LayoutMailbox) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

class LayoutMailboxes {
 public:
  LayoutMailboxes(const ArenaShape& shape, Region& region);

  LayoutMailbox& of(int env_index) const;

 private:
  const int64_t count_;
  LayoutMailbox* const mailboxes_;
};

}  // namespace comrad::shm
