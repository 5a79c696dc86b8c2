#include "learner/ranks/rank_processes.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <fstream>
#include <string>

#include "rollout_buffer/core/clock.h"
#include "tests/support/patience.h"

namespace comrad::learn {
namespace rank_processes_test {

/// What the processes of a test tell each other.
struct Board {
  std::array<std::atomic<pid_t>, 4> pid;
};

class RankProcessesTest : public ::testing::Test {
 protected:
  RankProcessesTest()
      : board_(static_cast<Board*>(
            mmap(nullptr, sizeof(Board), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0))) {}
  ~RankProcessesTest() override { munmap(board_, sizeof(Board)); }

  /// The others write down their ranks and wait for a signal; they never come back.
  RankProcesses fork(int count) {
    Expected<RankProcesses> processes = RankProcesses::fork(count);
    EXPECT_TRUE(processes);
    if (processes->rank() > 0) {
      board_->pid.at(static_cast<std::size_t>(processes->rank())) = getpid();
      while (true) pause();
    }
    return std::move(*processes);
  }
  bool have_begun(int count) const {
    return test::wait_until([&] {
      for (int rank = 1; rank < count; ++rank)
        if (board_->pid.at(static_cast<std::size_t>(rank)) == 0) return false;
      return true;
    });
  }

  Board* board_;
};

/// A zombie is not: where process 1 reaps no children, as in many containers, an orphan stays one.
bool is_alive(pid_t pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/stat");
  std::string line;
  std::getline(file, line);  // "<pid> (<name>) <state> ..."
  const std::size_t name_end = line.rfind(')');
  return name_end != std::string::npos && line.substr(name_end + 2, 1) != "Z";
}

TEST_F(RankProcessesTest, OneIsTheCallerAlone) {
  const auto alone = RankProcesses::fork(1);
  ASSERT_TRUE(alone);
  EXPECT_EQ(alone->rank(), 0);
  EXPECT_EQ(alone->count(), 1);
  EXPECT_EQ(alone->rendezvous(), -1);
}

TEST_F(RankProcessesTest, TheFirstReportsWhichOtherEndedAndHow) {
  RankProcesses processes = fork(3);
  ASSERT_TRUE(have_begun(3));
  EXPECT_TRUE(processes.check());
  kill(board_->pid[2], SIGKILL);
  Status checked;
  ASSERT_TRUE(test::wait_until([&] { return !(checked = processes.check()); }));
  EXPECT_EQ(checked.error().code, ErrorCode::kPeerLost);
  EXPECT_EQ(
      checked.error().message,
      "learner 2 of 3 was killed by signal 9 (Killed); all learners begin again from the last checkpoint");
  EXPECT_TRUE(processes.check()) << "said once";
}

TEST_F(RankProcessesTest, TheOthersAreGoneWhenTheFirstIsDoneWithThem) {
  { const RankProcesses processes = fork(4); }
  errno = 0;
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

TEST_F(RankProcessesTest, OneThatDoesNotStopIsKilled) {
  signal(SIGTERM, SIG_IGN);  // which the others inherit
  const double began_s = monotonic_s();
  { const RankProcesses processes = fork(2); }
  signal(SIGTERM, SIG_DFL);
  EXPECT_FALSE(is_alive(board_->pid[1]));
  EXPECT_GE(monotonic_s() - began_s, 1.5);
}

TEST_F(RankProcessesTest, TheOthersAreKilledWhenTheFirstDies) {
  const pid_t first = ::fork();
  if (first == 0) {
    const RankProcesses processes = fork(3);
    while (true) pause();
  }
  ASSERT_TRUE(have_begun(3));
  kill(first, SIGKILL);
  waitpid(first, nullptr, 0);
  for (const int rank : {1, 2})
    EXPECT_TRUE(test::wait_until([&] { return !is_alive(board_->pid.at(static_cast<std::size_t>(rank))); }))
        << rank;
}

}  // namespace rank_processes_test
}  // namespace comrad::learn
