// The one time limit of all waits in tests. It is far above what is waited for, so that a busy machine fails no test; what
// never comes is given up at last.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstdlib>

#include "rollout_buffer/core/clock.h"

namespace comrad::test {

constexpr double kPatienceSeconds = 300;

/// Factor on every time limit, from COMRAD_TEST_PATIENCE; 1 by default.
inline double patience() {
  const char* factor = std::getenv("COMRAD_TEST_PATIENCE");
  return factor == nullptr ? 1.0 : std::max(1.0, std::atof(factor));
}

/// When a wait that begins now is given up, on the clock of monotonic_s().
inline double deadline_s() { return monotonic_s() + kPatienceSeconds * patience(); }

/// Polls until `condition` holds, ever more slowly. False after `timeout_s`.
template <typename Condition>
bool wait_until(Condition&& condition, double timeout_s = kPatienceSeconds,
                useconds_t longest_pause_us = 50'000) {
  const double end_s = monotonic_s() + timeout_s * patience();
  for (useconds_t pause_us = 1000; !condition(); pause_us = 2 * pause_us) {
    if (monotonic_s() > end_s) return false;
    usleep(pause_us = std::min(pause_us, longest_pause_us));
  }
  return true;
}

}  // namespace comrad::test
