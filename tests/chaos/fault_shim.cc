// Preloaded into every process of a run (LD_PRELOAD), this plays a machine with faults:
//
//   COMRAD_FAULT_DISK_MS=n   a slow disk: fsync() and fdatasync() take n ms longer
//   COMRAD_FAULT_CLOCK_S=n   the clock is set: the time of day jumps n seconds ahead and back, every second
//
// It needs neither FUSE nor the device mapper, which containers seldom permit.
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <cstdlib>

namespace {

long setting(const char* name) {
  const char* text = std::getenv(name);
  return text == nullptr ? 0 : std::atol(text);
}

template <typename Function>
Function* real(Function*, const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

void wait_as_a_slow_disk() {
  static const long milliseconds = setting("COMRAD_FAULT_DISK_MS");
  const timespec wait{milliseconds / 1000, milliseconds % 1000 * 1'000'000};
  if (milliseconds > 0) nanosleep(&wait, nullptr);
}

time_t jump() {
  static const long seconds = setting("COMRAD_FAULT_CLOCK_S");
  static const auto gettime = real(&clock_gettime, "clock_gettime");
  timespec now{};
  if (seconds == 0 || gettime(CLOCK_MONOTONIC, &now) != 0) return 0;
  return now.tv_sec % 2 == 0 ? seconds : -seconds;
}

}  // namespace

extern "C" {

int fsync(int descriptor) {
  static const auto next = real(&fsync, "fsync");
  wait_as_a_slow_disk();
  return next(descriptor);
}

int fdatasync(int descriptor) {
  static const auto next = real(&fdatasync, "fdatasync");
  wait_as_a_slow_disk();
  return next(descriptor);
}

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  static const auto next = real(&clock_gettime, "clock_gettime");
  const int result = next(clock, time);
  if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) time->tv_sec += jump();
  return result;
}

int gettimeofday(timeval* time, void* zone) noexcept {
  timespec now{};
  (void)zone;
  const int result = clock_gettime(CLOCK_REALTIME, &now);
  time->tv_sec = now.tv_sec;
  time->tv_usec = now.tv_nsec / 1000;
  return result;
}

time_t time(time_t* out) noexcept {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  if (out != nullptr) *out = now.tv_sec;
  return now.tv_sec;
}
}
