// The exit codes of test programs, which ctest reads: this program runs its own cases, which are
// disabled here.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace comrad {
namespace {

TEST(Probe, DISABLED_Passes) {}
TEST(Probe, DISABLED_Skips) { GTEST_SKIP() << "on purpose"; }
TEST(Probe, DISABLED_Fails) { FAIL() << "on purpose"; }

int exit_code_of(const std::string& cases) {
  const std::string program = std::filesystem::read_symlink("/proc/self/exe").string();
  const std::string command =
      "'" + program + "' --gtest_also_run_disabled_tests --gtest_filter='" + cases + "' > /dev/null 2>&1";
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(ExitCode, DistinguishesPassedSkippedAndFailed) {
  EXPECT_EQ(exit_code_of("Probe.DISABLED_Passes"), 0);
  EXPECT_EQ(exit_code_of("Probe.DISABLED_Skips"), 77);
  EXPECT_EQ(exit_code_of("Probe.DISABLED_Passes:Probe.DISABLED_Skips"), 77);
  EXPECT_EQ(exit_code_of("Probe.DISABLED_Fails"), 1);
}

TEST(ExitCode, ASkippedCaseDoesNotHideAFailedOne) { EXPECT_EQ(exit_code_of("Probe.*"), 1); }

}  // namespace
}  // namespace comrad
