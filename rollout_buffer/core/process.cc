#include "rollout_buffer/core/process.h"

#include <fcntl.h>
#include <signal.h>

namespace comrad {

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

}  // namespace comrad
