#include "deploy/process/child_program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>

namespace comrad::deploy {
namespace child_program_test {

using ::testing::ElementsAre;

std::vector<std::string> shell(const std::string& script) { return {"sh", "-c", script}; }

TEST(RunProgram, KeepsBothStreamsAndTheExitCode) {
  const auto result = run_program(shell("echo out; echo err >&2; exit 3"));
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->output, "out\n");
  EXPECT_EQ(result->error_output, "err\n");
  EXPECT_EQ(result->exit_code, 3);
}

TEST(RunProgram, DistinguishesASignalFromAnExit) {
  const auto result = run_program(shell("kill -9 $$"));
  ASSERT_TRUE(result);
  EXPECT_EQ(result->exit_code, 128 + SIGKILL);
}

TEST(RunProgram, HandsLinesOverWhole) {
  std::vector<std::string> lines;
  ProgramOptions options;
  options.on_line = [&](const std::string& line) { lines.push_back(line); };
  ASSERT_TRUE(run_program(shell("printf 'a'; sleep 0.05; printf 'b\\nc\\n'"), options));
  EXPECT_THAT(lines, ElementsAre("ab", "c"));
}

TEST(RunProgram, GivesItsEnvironmentOnTopOfOurs) {
  const auto result = run_program(shell("printf '%s %s' \"$COMRAD_TEST_NEW\" \"${PATH:+ours}\""),
                                  {.environment = {{"COMRAD_TEST_NEW", "new"}}});
  ASSERT_TRUE(result);
  EXPECT_EQ(result->output, "new ours");
}

TEST(RunProgram, DoesNotBlockOnMoreThanAPipeHolds) {
  const auto result = run_program(shell("head -c 3000000 /dev/zero; head -c 3000000 /dev/zero >&2"));
  ASSERT_TRUE(result);
  EXPECT_EQ(result->output.size(), 3000000u);
  EXPECT_EQ(result->error_output.size(), 3000000u);
}

TEST(RunProgram, KillsWhatTakesTooLong) {
  const auto result = run_program(shell("exec sleep 100000"), {.timeout_s = 0.2});
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kTimeout);
}

TEST(RunProgram, NamesAProgramThatIsNotThere) {
  for (const char* name : {"/no/such/program", "no-such-program-on-the-path"}) {
    const auto result = run_program({name});
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, ErrorCode::kNotFound);
  }
}

TEST(RunProgram, PassesAnInterruptOnAndReportsIt) {
  sigset_t interrupt, previous;
  sigemptyset(&interrupt);
  sigaddset(&interrupt, SIGINT);
  pthread_sigmask(SIG_BLOCK, &interrupt, &previous);
  ProgramOptions options;
  options.on_line = [](const std::string&) { kill(getpid(), SIGINT); };
  const auto result = run_program(shell("echo up; exec sleep 100000"), options);
  pthread_sigmask(SIG_SETMASK, &previous, nullptr);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(result->interrupted);
  EXPECT_EQ(result->exit_code, 128 + SIGTERM);
}

TEST(LastWords, AreTheLastLineWithoutItsPrefix) {
  EXPECT_EQ(
      last_words({.output = "", .error_output = "warming up\ncomrad-doomgen: error: no such scenario\n\n"}),
      "no such scenario");
  EXPECT_EQ(last_words({.output = "", .error_output = "comrad-scenarios: unknown: x y"}), "unknown: x y");
  EXPECT_EQ(last_words({.output = "", .error_output = "Segmentation fault: 11"}), "Segmentation fault: 11");
  EXPECT_EQ(last_words({.output = "", .error_output = ""}), "");
}

}  // namespace child_program_test
}  // namespace comrad::deploy
