// Which places for simulators of other hosts are whose, on the learner's host. It stands in the arena, so that a process which
// takes over from a dead one knows it, and how much was sealed for each host. Stage: beside the flow.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

/// What came of one host.
struct FeederRecord {
  uint64_t feeder_id = 0;
  std::string host;
  int workers = 0;
  bool is_here = false;
  uint64_t credits = 0;       ///< slabs that it may send before the learner takes some
  uint64_t decisions = 0;     ///< sealed here
  uint64_t slabs = 0;         ///< sealed here
  uint64_t duplicates = 0;    ///< slabs or requests that had come before
  uint64_t refused = 0;       ///< slabs or batches that no simulator could have made
  uint64_t missing = 0;       ///< rollouts, or batches of frames, that never came
  uint64_t played_there = 0;  ///< decisions, by that host's own word
  uint64_t lost_there = 0;    ///< of them, by its word: sent to this run before it began anew
};

/// Threads: one.
class Seats {
 public:
  /// Simulators [first_worker, first_worker + worker_count) of the arena are played by other hosts; whose they are is read
  /// from it.
  Seats(const shm::Arena& arena, int first_worker, int worker_count);

  int count() const { return static_cast<int>(owner_.size()); }
  int free_count() const;
  /// Workers of the arena, in their order; empty where the host has none.
  std::vector<int> of(uint64_t feeder_id) const;
  /// Gives it so many, which are free. Its trajectories are counted anew.
  std::vector<int> take(uint64_t feeder_id, int count);
  void free(uint64_t feeder_id);
  /// The rollout index in this arena of rollout `theirs` of the host that plays `env`. It counts on, whoever plays, with one
  /// number left out between two hosts, so that nobody takes one's trajectory for a continuation of the other's.
  uint64_t rollout_of(int env, uint64_t theirs);
  /// Agent decisions sealed for it since it got its places, to the last one.
  uint64_t sealed_for(uint64_t feeder_id) const;

 private:
  const shm::Arena& arena_;
  const int first_worker_;
  std::vector<uint64_t> owner_;  ///< by place; 0: free
};

}  // namespace comrad::link
