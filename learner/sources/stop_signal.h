// The learner's one answer to "is it time to stop?": SIGTERM or the run's desired state, and since when.
#pragma once

#include <atomic>
#include <cstdint>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/shm/is_stopping.h"

namespace comrad::learn {

constexpr int64_t kPollUs = 50'000;  ///< bound on every wait of a thread, so that a stop is seen

/// Threads: one reads; a signal handler and the supervisor raise what it looks at.
class StopSignal {
 public:
  /// `raised` by a signal handler, the run state by the supervisor; both outlive the object.
  StopSignal(const std::atomic<bool>& raised, const shm::Arena& arena) : raised_(raised), arena_(arena) {}

  bool requested() {
    const bool stopping = shm::is_stopping(raised_, arena_);
    if (stopping && seen_s_ == 0) seen_s_ = monotonic_s();
    return stopping;
  }
  /// Since requested() saw it first; 0 before.
  double seconds_since() const { return seen_s_ == 0 ? 0 : monotonic_s() - seen_s_; }

 private:
  const std::atomic<bool>& raised_;
  const shm::Arena& arena_;
  double seen_s_ = 0;
};

}  // namespace comrad::learn
