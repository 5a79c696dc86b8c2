#include "deploy/process/child_process.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include "tests/support/patience.h"

namespace comrad::deploy {
namespace child_process_test {

using testing::ElementsAre;
using testing::HasSubstr;

ChildOptions shell(const std::string& script) {
  ChildOptions options;
  options.program = "/bin/sh";
  options.arguments = {"-c", script};
  return options;
}

/// Runs to the end and returns all lines.
std::vector<std::string> run_shell(const ChildOptions& options, ExitStatus* how = nullptr) {
  auto child = ChildProcess::spawn(options);
  EXPECT_TRUE(child) << child.error().message;
  std::vector<std::string> all;
  const auto read_all = [&] {
    for (std::string& line : child->read_lines()) all.push_back(line);
  };
  EXPECT_TRUE(test::wait_until([&] { return read_all(), child->poll_exit().has_value(); }));
  read_all();
  if (how != nullptr && child->poll_exit()) *how = *child->poll_exit();
  return all;
}

TEST(ChildProcess, BringsBackLinesOfBothOutputsAndTheExitCode) {
  ExitStatus how;
  EXPECT_THAT(run_shell(shell("echo one; echo two >&2; printf three; exit 7"), &how),
              ElementsAre("one", "two", "three"));
  EXPECT_EQ(how.code, 7);
  EXPECT_EQ(how.text(), "exit code 7");
  run_shell(shell("kill -9 $$"), &how);
  EXPECT_EQ(how.text(), "killed by signal 9 (Killed)");
}

TEST(ChildProcess, ReadsItsInputToTheEnd) {
  MachineProcessHost host;
  ChildOptions options = shell("read line; echo \"heard $line\"; cat; echo end");
  options.takes_input = true;
  const auto child = host.spawn(options);
  ASSERT_TRUE(child) << child.error().message;
  (*child)->write_input("one\ntwo\n");
  (*child)->end_input();
  (*child)->write_input("three\n");
  std::vector<std::string> lines;
  const auto read_all = [&] {
    for (std::string& line : (*child)->read_lines()) lines.push_back(line);
  };
  EXPECT_TRUE(test::wait_until([&] { return read_all(), (*child)->poll_exit().has_value(); }));
  read_all();
  EXPECT_THAT(lines, ElementsAre("heard one", "two", "end"));
}

TEST(ChildProcess, WaitsItsTurnWhereItIsAskedTo) {
  for (const bool waits : {false, true}) {
    ChildOptions options = shell("read line");
    options.takes_input = true, options.waits_its_turn = waits;
    auto child = ChildProcess::spawn(options);
    ASSERT_TRUE(child) << child.error().message;
    const int before = sched_getscheduler(0);
    EXPECT_EQ(sched_getscheduler(child->pid()), waits && before == SCHED_OTHER ? SCHED_BATCH : before);
  }
}

TEST(ChildProcess, CountsTheProcessorTimeOfAChildWhileItRunsAndAfterwards) {
  auto child = ChildProcess::spawn(shell("trap 'exit 0' TERM; while :; do :; done"));
  ASSERT_TRUE(child) << child.error().message;
  ASSERT_TRUE(test::wait_until([&] { return child->cpu_seconds() >= 0.1; }));
  const double running_s = child->cpu_seconds();
  child->send_signal(SIGTERM);
  ASSERT_TRUE(test::wait_until([&] { return child->poll_exit().has_value(); }));
  EXPECT_GE(child->cpu_seconds(), running_s - 0.011) << "ticks of 10 ms";
  const ChildProcess moved = std::move(*child);
  EXPECT_GE(moved.cpu_seconds(), running_s - 0.011);
}

TEST(ChildProcess, IsAtWorkWhileItNeedsACoreButNotWhileItWaitsOrIsStopped) {
  auto child = ChildProcess::spawn(shell("trap 'exec sleep 1000' TERM; while :; do :; done"));
  ASSERT_TRUE(child) << child.error().message;
  EXPECT_TRUE(test::wait_until([&] { return child->is_at_work(); }));
  child->send_signal(SIGSTOP);
  EXPECT_TRUE(test::wait_until([&] { return child->is_stopped() && !child->is_at_work(); }));
  child->send_signal(SIGTERM), child->send_signal(SIGCONT);
  EXPECT_TRUE(test::wait_until([&] { return !child->is_stopped() && !child->is_at_work(); }));
  child->send_signal(SIGKILL);
  EXPECT_TRUE(test::wait_until([&] { return child->poll_exit().has_value(); }));
  EXPECT_FALSE(child->is_at_work());
}

TEST(ChildProcess, OutputMayGoElsewhereAndErrorsStillComeBack) {
  int ends[2];
  ASSERT_EQ(pipe2(ends, O_CLOEXEC), 0);
  ChildOptions options = shell("echo result; echo warning >&2");
  options.output = ends[1];
  EXPECT_THAT(run_shell(options), ElementsAre("warning"));
  close(ends[1]);
  char bytes[32] = {};
  EXPECT_EQ(read(ends[0], bytes, sizeof bytes), 7);
  EXPECT_STREQ(bytes, "result\n");
  close(ends[0]);
}

TEST(ChildProcess, ControlCharactersDoNotReachTheTerminal) {
  EXPECT_THAT(run_shell(shell("printf 'a\\033[2Jb\\r\\n'")), ElementsAre("a [2Jb"));
}

TEST(ChildProcess, AnEndlessLineIsCutInPieces) {
  const std::vector<std::string> lines = run_shell(shell("head -c 100000 /dev/zero | tr '\\0' x"));
  std::size_t sum = 0;
  for (const std::string& line : lines) {
    EXPECT_LE(line.size(), 4096u);
    sum += line.size();
  }
  EXPECT_EQ(sum, 100000u);
}

TEST(ChildProcess, SeesItsEnvironmentOnTopOfOurs) {
  setenv("COMRAD_TEST_OURS", "ours", 1);
  setenv("COMRAD_TEST_BOTH", "ours", 1);
  ChildOptions options = shell("echo $COMRAD_TEST_OURS $COMRAD_TEST_BOTH $COMRAD_TEST_NEW");
  options.environment = {{"COMRAD_TEST_BOTH", "theirs"}, {"COMRAD_TEST_NEW", "new"}};
  EXPECT_THAT(run_shell(options), ElementsAre("ours theirs new"));
}

TEST(ChildProcess, InheritsNoDescriptorButTheNamedOne) {
  int ours[2];
  ASSERT_EQ(pipe(ours), 0);  // deliberately without close-on-exec
  ChildOptions options = shell("exec ls /proc/self/fd | tr '\\n' ' '");
  // 3 is the folder that ls reads.
  EXPECT_THAT(run_shell(options), ElementsAre(HasSubstr("0 1 2 3 ")));
  EXPECT_THAT(run_shell(options)[0].size(), 8u);
  options.inherited_descriptor = ours[0];
  EXPECT_THAT(run_shell(options), ElementsAre("0 1 2 3 4 "));
  close(ours[0]);
  close(ours[1]);
}

TEST(ChildProcess, SignalsAreAsAFreshProgramExpectsThemExceptTheTerminals) {
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, &before);
  const std::vector<std::string> lines = run_shell(shell("grep -E 'SigBlk|SigIgn' /proc/self/status"));
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(std::stoull(lines[0].substr(8), nullptr, 16), 0u);
  const uint64_t ignored = std::stoull(lines[1].substr(8), nullptr, 16);
  EXPECT_TRUE(ignored & (1u << (SIGINT - 1)));
  EXPECT_TRUE(ignored & (1u << (SIGHUP - 1)));
  EXPECT_FALSE(ignored & (1u << (SIGTERM - 1)));
}

TEST(ChildProcess, AProgramThatIsNotThereIsAnErrorHereAndNotADeathLater) {
  ChildOptions options;
  options.program = "/nowhere/comrad-sim-worker";
  auto child = ChildProcess::spawn(options);
  ASSERT_FALSE(child);
  EXPECT_EQ(child.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(child.error().message, HasSubstr("/nowhere/comrad-sim-worker: No such file"));
}

TEST(ChildProcess, OneThatIsStoppedIsSeenAsStopped) {
  auto child = ChildProcess::spawn(shell("exec sleep 60"));
  ASSERT_TRUE(child);
  EXPECT_FALSE(child->is_stopped());
  child->send_signal(SIGSTOP);
  EXPECT_TRUE(test::wait_until([&] { return child->is_stopped(); }));
  child->send_signal(SIGCONT);
  EXPECT_TRUE(test::wait_until([&] { return !child->is_stopped(); }));
}

TEST(ChildProcess, DestroyingItEndsIt) {
  pid_t pid = 0;
  {
    auto child = ChildProcess::spawn(shell("exec sleep 60"));
    ASSERT_TRUE(child);
    pid = child->pid();
    EXPECT_EQ(kill(pid, 0), 0);
  }
  EXPECT_NE(kill(pid, 0), 0);
}

}  // namespace child_process_test
}  // namespace comrad::deploy
