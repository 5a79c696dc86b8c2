#include "learner/ranks/rank_processes.h"

#include <spdlog/fmt/fmt.h>

#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"

namespace comrad::learn {
namespace {

constexpr double kStopWithinS = 4;

std::string text_of(int status) {
  if (WIFSIGNALED(status))
    return fmt::format("was killed by signal {} ({})", WTERMSIG(status), strsignal(WTERMSIG(status)));
  return fmt::format("ended with exit code {}", WEXITSTATUS(status));
}

}  // namespace

Expected<RankProcesses> RankProcesses::fork(int count) {
  RankProcesses processes;
  processes.count_ = count;
  if (count == 1) return processes;
  processes.rendezvous_ = memfd_create("comrad-learners", MFD_CLOEXEC);
  if (processes.rendezvous_ < 0) return system_error("memfd_create for the learners' rendezvous");
  const pid_t parent = getpid();
  for (int rank = 1; rank < count; ++rank) {
    const pid_t pid = ::fork();
    if (pid < 0) return system_error(fmt::format("starting learner {}", rank));
    if (pid == 0) {
      // Killed, not stopped: the first rank's successor begins at once, and no old rank may be running.
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (getppid() != parent) _exit(kExitFailed);  // it died before the line above
      processes.rank_ = rank;
      processes.others_.clear();
      return processes;
    }
    processes.others_.push_back(pid);
  }
  return processes;
}

RankProcesses::RankProcesses(RankProcesses&& other) noexcept
    : rank_(other.rank_),
      count_(other.count_),
      rendezvous_(std::exchange(other.rendezvous_, -1)),
      others_(std::exchange(other.others_, {})) {}

RankProcesses::~RankProcesses() {
  stop();
  const double until_s = monotonic_s() + kStopWithinS * patience();
  for (pid_t& pid : others_) {
    if (pid == 0) continue;
    while (waitpid(pid, nullptr, WNOHANG) == 0) {
      if (monotonic_s() > until_s) kill(pid, SIGKILL);
      usleep(2000);
    }
  }
  if (rendezvous_ >= 0) close(rendezvous_);
}

Status RankProcesses::check() {
  for (std::size_t i = 0; i < others_.size(); ++i) {
    int status = 0;
    if (others_[i] == 0 || waitpid(others_[i], &status, WNOHANG) <= 0) continue;
    others_[i] = 0;
    return Error{ErrorCode::kPeerLost,
                 fmt::format("learner {} of {} {}; all learners begin again from the last checkpoint", i + 1,
                             count_, text_of(status))};
  }
  return {};
}

void RankProcesses::stop() {
  for (const pid_t pid : others_)
    if (pid != 0) kill(pid, SIGTERM);
}

}  // namespace comrad::learn
