#include "deploy/launch/restart_policy.h"

#include <gtest/gtest.h>

namespace comrad::deploy {
namespace restart_policy_test {

TEST(RestartHistory, DoublesTheDelayUpToItsLimit) {
  RestartHistory history;
  const double expected_s[] = {0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 10, 10, 10};
  for (const double delay_s : expected_s) EXPECT_DOUBLE_EQ(history.next_delay_s(0, true).value(), delay_s);
}

TEST(RestartHistory, GivesUpAtTheTenthDeathInsideTheWindow) {
  RestartHistory history;
  for (int death = 0; death < 9; ++death) EXPECT_TRUE(history.next_delay_s(death * 6.0, true));
  EXPECT_FALSE(history.next_delay_s(59.9, true));
}

TEST(RestartHistory, ForgetsDeathsThatAreLongPast) {
  RestartHistory history;
  for (int death = 0; death < 100; ++death) ASSERT_TRUE(history.next_delay_s(death * 7.0, true)) << death;
  EXPECT_DOUBLE_EQ(history.next_delay_s(10'000, true).value(), 0.2);
}

TEST(RestartHistory, GivesUpOnAWorkerThatNeverWorksHoweverSlowlyItDies) {
  RestartHistory history;
  for (int death = 0; death < 9; ++death) EXPECT_TRUE(history.next_delay_s(death * 100.0, false));
  EXPECT_FALSE(history.next_delay_s(900, false));
  RestartHistory other;
  for (int death = 0; death < 50; ++death) EXPECT_TRUE(other.next_delay_s(death * 100.0, death % 9 == 8));
}

}  // namespace restart_policy_test
}  // namespace comrad::deploy
