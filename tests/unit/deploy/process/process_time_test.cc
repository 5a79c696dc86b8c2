#include "deploy/process/process_time.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/patience.h"

namespace comrad::deploy {
namespace process_time_test {

TEST(ProcessSeconds, ReadsPastANameWithSpacesAndParentheses) {
  EXPECT_NEAR(process_seconds("12 (a) b (c)) S 1 2 3 4 5 6 7 8 9 10 150 50 0 0"), 2.0, 1e-9);
  EXPECT_NEAR(process_seconds("12 (x) S 1 2 3 4 5 6 7 8 9 10 150 50 30 20"), 2.5, 1e-9)
      << "of ended children";
  EXPECT_EQ(process_seconds(""), 0);
  EXPECT_EQ(process_seconds("12 (x) S 1"), 0);
}

TEST(FamilySeconds, CountsAChildOfAChildWhileItRuns) {
  const pid_t idle = fork();
  if (idle == 0) {
    setpgid(0, 0);
    if (fork() == 0)
      for (volatile bool goes_on = true; goes_on;) {
      }
    while (true) pause();
  }
  ASSERT_GT(idle, 0);
  EXPECT_TRUE(test::wait_until([&] { return family_seconds(idle) >= 0.1; }));
  kill(-idle, SIGKILL);
  waitpid(idle, nullptr, 0);
  EXPECT_EQ(family_seconds(idle), 0);
}

}  // namespace process_time_test
}  // namespace comrad::deploy
