// The supervisor's signals as a descriptor to poll.
#pragma once

#include <signal.h>

namespace comrad::deploy {

/// Takes over SIGINT, SIGTERM, SIGHUP, SIGUSR1 (but those that were ignored at the start) and SIGCHLD for as long as it
/// lives, and keeps SIGPIPE away: a reader of
/// our progress that leaves must not end the run. Make it before everything that starts threads, so that they inherit
/// the mask.
class SignalQueue {
 public:
  SignalQueue();
  SignalQueue(const SignalQueue&) = delete;
  SignalQueue& operator=(const SignalQueue&) = delete;
  ~SignalQueue();

  /// Readable while a signal is pending; -1 if the system gave none (errno has the reason).
  int descriptor() const { return descriptor_; }
  /// Next pending signal, or 0.
  int next();

 private:
  int descriptor_ = -1;
  sigset_t taken_{};
  sigset_t before_{};
};

}  // namespace comrad::deploy
