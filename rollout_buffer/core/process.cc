#include "rollout_buffer/core/process.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>

namespace comrad {
namespace {

constexpr int kBackgroundPriority = 10;  // a tenth of what another process takes of a core that both want
constexpr double kBackgroundPatience = 20;
constexpr int kIoIdleClass = 3 << 13, kIoOfProcess = 1;  // ioprio_set(2)

}  // namespace

int exit_code(const Error& error) {
  switch (error.code) {
    case ErrorCode::kBadInput:
    case ErrorCode::kBadFormat:
    case ErrorCode::kNotFound:
    case ErrorCode::kUnsupported:
      return kExitBadInput;
    case ErrorCode::kNotSaved:
      return kExitNotSaved;
    case ErrorCode::kNoSpace:
    case ErrorCode::kPeerLost:
    case ErrorCode::kSystem:
    case ErrorCode::kTimeout:
      return kExitFailed;
  }
  return kExitFailed;
}

void prepare_process() {
  for (int descriptor = 0; descriptor <= 2; ++descriptor)
    if (fcntl(descriptor, F_GETFD) < 0) (void)!open("/dev/null", descriptor == 0 ? O_RDONLY : O_WRONLY);
  signal(SIGPIPE, SIG_IGN);
  signal(SIGXFSZ, SIG_IGN);
}

sigset_t heard_of(std::initializer_list<int> signals) {
  sigset_t heard;
  sigemptyset(&heard);
  for (const int number : signals) {
    struct sigaction now {};
    if (sigaction(number, nullptr, &now) == 0 && now.sa_handler != SIG_IGN) sigaddset(&heard, number);
  }
  return heard;
}

void yield_to_others() {
  setpriority(PRIO_PROCESS, 0, std::max(kBackgroundPriority, getpriority(PRIO_PROCESS, 0)));
  syscall(SYS_ioprio_set, kIoOfProcess, 0, kIoIdleClass);  // best effort: some disk queues ignore priorities
}

double patience() {
  return getpriority(PRIO_PROCESS, 0) > 0 || sched_getscheduler(0) == SCHED_IDLE ? kBackgroundPatience : 1;
}

}  // namespace comrad
