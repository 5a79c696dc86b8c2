#include "rollout_buffer/core/process.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace comrad {
namespace process_test {

TEST(YieldToOthers, IsALowPriorityOfTheProcessAndItsChildrenAndMakesPatient) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    yield_to_others();
    const bool is_low = getpriority(PRIO_PROCESS, 0) >= 10 && patience() > 1;
    const pid_t grandchild = fork();
    if (grandchild == 0) _exit(getpriority(PRIO_PROCESS, 0) >= 10 ? 0 : 1);
    int status = 1;
    waitpid(grandchild, &status, 0);
    setpriority(PRIO_PROCESS, 0, 15);
    const int lower = getpriority(PRIO_PROCESS, 0);
    yield_to_others();
    _exit(is_low && status == 0 && getpriority(PRIO_PROCESS, 0) == lower ? 0 : 1);
  }
  int status = 1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  if (getpriority(PRIO_PROCESS, 0) <= 0) {
    EXPECT_EQ(patience(), 1);  // under nice(1) it is not
  }
}

TEST(ExitCode, DistinguishesBadInputFromFailure) {
  EXPECT_EQ(exit_code({ErrorCode::kBadInput, ""}), kExitBadInput);
  EXPECT_EQ(exit_code({ErrorCode::kNotFound, ""}), kExitBadInput);
  EXPECT_EQ(exit_code({ErrorCode::kNoSpace, ""}), kExitFailed);
  EXPECT_EQ(exit_code({ErrorCode::kNotSaved, ""}), kExitNotSaved);
}

}  // namespace process_test
}  // namespace comrad
