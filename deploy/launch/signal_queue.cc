#include "deploy/launch/signal_queue.h"

#include <sys/signalfd.h>
#include <unistd.h>

#include "rollout_buffer/core/process.h"

namespace comrad::deploy {

SignalQueue::SignalQueue() {
  sigset_t mask = heard_of({SIGINT, SIGTERM, SIGHUP, SIGUSR1});
  sigaddset(&mask, SIGCHLD);
  descriptor_ = signalfd(-1, &mask, SFD_CLOEXEC | SFD_NONBLOCK);
  sigaddset(&mask, SIGPIPE);
  taken_ = mask;
  pthread_sigmask(SIG_BLOCK, &mask, &before_);
}

SignalQueue::~SignalQueue() {
  if (descriptor_ >= 0) close(descriptor_);
  const timespec at_once{};
  while (sigtimedwait(&taken_, nullptr, &at_once) > 0) {
  }
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

int SignalQueue::next() {
  signalfd_siginfo info{};
  return read(descriptor_, &info, sizeof info) == sizeof info ? static_cast<int>(info.ssi_signo) : 0;
}

}  // namespace comrad::deploy
