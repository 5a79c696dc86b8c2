// What became of trajectories that this host drained for another one. The counts lie in the arena, so that a process which
// takes over from a dead one knows what it had done. Stage: drain.
#pragma once

#include <cstdint>
#include <vector>

#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

/// Counts agent decisions. Threads: one.
class DeliveryAccount {
 public:
  explicit DeliveryAccount(const shm::Arena& arena) : arena_(arena) {}

  /// Goes on from a predecessor's counts. Gives the slabs that it had drained and had not done with, in the order of sealing.
  std::vector<uint32_t> begin_life();
  /// The oldest of the slabs in hand was sealed on the other host, or may have been lost there. Gives it back.
  void finish(uint32_t slab, bool is_delivered);
  uint64_t decisions_of(uint32_t slab) const;

  uint64_t delivered() const { return delivered_; }
  uint64_t lost() const { return lost_; }

 private:
  const shm::Arena& arena_;
  uint64_t delivered_ = 0, lost_ = 0;
};

/// What became of this host's decisions, all agents counted: played = delivered + waiting + unfinished + lost, and what
/// simulators that died had in the making.
struct FeederAccount {
  uint64_t played = 0;
  uint64_t delivered = 0;   ///< sealed on the learner's host
  uint64_t waiting = 0;     ///< sealed here, or sent and not yet done
  uint64_t unfinished = 0;  ///< in slabs that are being filled
  uint64_t lost = 0;    ///< sent to a learner's host that began anew: they may have been learned there or not
  uint64_t resent = 0;  ///< slabs that were sent once more
};

/// All but `resent`.
FeederAccount account_of(const shm::Arena& arena, const DeliveryAccount& deliveries);

}  // namespace comrad::link
