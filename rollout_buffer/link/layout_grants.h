// Maps of a pool for simulators that play for another host's learner: drawn evenly, by this host. Stage: reset.
#pragma once

#include <cstdint>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

/// Threads: one.
class LayoutGrants {
 public:
  /// `layout_count` of the pool; 0: one map, nothing is granted.
  LayoutGrants(const shm::Arena& arena, uint64_t feeder_id, int layout_count)
      : arena_(arena), layout_count_(layout_count), draws_(RngKey(feeder_id).split("layouts")) {}

  /// Each environment that took its last layout is granted another. How episodes ended is nobody's business here.
  void grant();

 private:
  const shm::Arena& arena_;
  const int layout_count_;
  Rng draws_;
};

}  // namespace comrad::link
