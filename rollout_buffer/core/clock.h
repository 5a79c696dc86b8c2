// Seconds for waits, rates and reports. Simulated time (tics) never comes from here.
#pragma once

#include <atomic>
#include <cstdint>
#include <ctime>

namespace comrad {

inline double clock_s(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Monotonic nanoseconds, comparable between the processes of one host.
inline int64_t monotonic_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

inline double monotonic_s() { return static_cast<double>(monotonic_ns()) * 1e-9; }

/// Time as an argument of what supervises, waits and reports, so that a simulation plays hours of it in a moment. It counts
/// from an arbitrary start and never goes back. Threads: any.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual int64_t now_ns() const = 0;
  double now_s() const { return static_cast<double>(now_ns()) * 1e-9; }
};

/// The machine's, as monotonic_ns() has it.
class MachineClock final : public Clock {
 public:
  int64_t now_ns() const override { return monotonic_ns(); }
};
inline const MachineClock kMachineClock;

/// A simulation's: it stands still until it is moved.
class ManualClock final : public Clock {
 public:
  int64_t now_ns() const override { return now_ns_.load(); }
  void advance_ns(int64_t by_ns) { now_ns_ += by_ns; }
  void advance_s(double by_s) { advance_ns(static_cast<int64_t>(by_s * 1e9)); }

 private:
  std::atomic<int64_t> now_ns_ = 1'000'000'000;  // 0 often means "never"
};

/// Seconds since 1970 (UTC): for files that people read, not for differences.
inline double wall_s() { return clock_s(CLOCK_REALTIME); }

/// Processor time of this process or thread, which a busy machine does not stretch.
inline double process_cpu_s() { return clock_s(CLOCK_PROCESS_CPUTIME_ID); }
inline double thread_cpu_s() { return clock_s(CLOCK_THREAD_CPUTIME_ID); }

/// Seconds since it was made, on the wall and of the processor time of this thread or, with
/// CLOCK_PROCESS_CPUTIME_ID, of the whole process.
class Stopwatch {
 public:
  explicit Stopwatch(clockid_t cpu_clock = CLOCK_THREAD_CPUTIME_ID) : cpu_clock_(cpu_clock) {}
  double elapsed() const { return monotonic_s() - begin_; }
  double cpu_elapsed() const { return clock_s(cpu_clock_) - cpu_begin_; }

 private:
  clockid_t cpu_clock_;
  double begin_ = monotonic_s(), cpu_begin_ = clock_s(cpu_clock_);
};

}  // namespace comrad
