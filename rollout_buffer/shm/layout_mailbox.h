// Where each environment's maps come from while it trains on a pool of layouts.
//
//   LayoutMailbox [env]
//
// Writers: the simulator reports how its episodes ended and takes its assignments; the learner's curriculum (on other hosts
// the trajectory sender) reads the one and writes the other.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

constexpr std::size_t kMailboxOutcomes = 8;

/// Neither side waits: a simulator whose draw is due while no new assignment lies there plays its layout once more.
///
///   simulator  outcome[reported % 8], ++reported     assigned != taken: playing = layout_index, taken = assigned
///   learner    reads outcomes [heard, reported)      assigned == taken: layout_index = a draw, ++assigned
struct alignas(kCacheLineBytes) LayoutMailbox {
  // Simulator.
  std::array<std::atomic<uint64_t>, kMailboxOutcomes> outcome;  ///< pack_outcome() of finished episodes
  alignas(kCacheLineBytes) std::atomic<uint64_t> reported;
  std::atomic<uint32_t> taken;    ///< assignments taken so far
  std::atomic<uint32_t> playing;  ///< layout of the present episode, by its index in the pool
  std::atomic<uint32_t> late;     ///< draws that were due while no new assignment lay there
  // Learner.
  alignas(kCacheLineBytes) std::atomic<uint64_t> heard;
  std::atomic<uint32_t> assigned;      ///< assignments given so far
  std::atomic<uint32_t> layout_index;  ///< of the newest assignment, in the pool

  /// Simulator: plays the newest assignment from now on; where there is none, counts the draw as late.
  void take_assignment();
  /// Learner: the last assignment was taken, another one is due.
  bool is_due() const {
    return taken.load(std::memory_order_acquire) == assigned.load(std::memory_order_relaxed);
  }
  /// Learner: a new assignment, where one is due.
  void assign(uint32_t layout_index_of_pool);
};
static_assert(sizeof(LayoutMailbox) == 3 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// One finished episode in a word, so that it is never seen half written.
struct LayoutOutcome {
  uint32_t layout_index = 0;
  float score = 0;  ///< J, team level
};
uint64_t pack_outcome(const LayoutOutcome& outcome);
LayoutOutcome unpack_outcome(uint64_t word);

class LayoutMailboxes {
 public:
  LayoutMailboxes(const ArenaShape& shape, Region& region);

  LayoutMailbox& of(int env_index) const;

 private:
  const int64_t count_;
  LayoutMailbox* const mailboxes_;
};

}  // namespace comrad::shm
