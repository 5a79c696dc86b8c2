// Monotonic time for waits and rates. Simulated time (tics) never comes from here.
#pragma once

#include <cstdint>
#include <ctime>

namespace comrad {

/// Monotonic nanoseconds, comparable between the processes of one host.
inline int64_t monotonic_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

inline double monotonic_s() { return static_cast<double>(monotonic_ns()) * 1e-9; }

}  // namespace comrad
