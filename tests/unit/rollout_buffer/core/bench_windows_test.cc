#include "rollout_buffer/core/bench_windows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad {
namespace bench_windows_test {

using ::testing::DoubleEq;
using ::testing::ElementsAre;

TEST(MedianOf, IsTheMiddleOrTheMeanOfTheTwoInTheMiddle) {
  EXPECT_EQ(median_of({}), 0);
  EXPECT_EQ(median_of({7}), 7);
  EXPECT_EQ(median_of({9, 1, 2}), 2);
  EXPECT_EQ(median_of({9, 1, 2, 4}), 3);
}

TEST(SpreadOf, IsTheRangeOverTheMedian) {
  EXPECT_EQ(spread_of({}), 0);
  EXPECT_EQ(spread_of({5}), 0);
  EXPECT_EQ(spread_of({0, 0}), 0);
  EXPECT_DOUBLE_EQ(spread_of({8, 10, 14}), 0.6);
}

TEST(BenchWindows, EachHoldsTheRateOfItsTime) {
  BenchWindows windows(4, 2);
  EXPECT_FALSE(windows.see(10, 1));
  EXPECT_FALSE(windows.see(20, 2));
  EXPECT_FALSE(windows.see(60, 3));
  EXPECT_TRUE(windows.see(100, 4));
  EXPECT_THAT(windows.rates(), ElementsAre(DoubleEq(10), DoubleEq(40)));
  EXPECT_DOUBLE_EQ(windows.median(), 25);
  EXPECT_DOUBLE_EQ(windows.spread(), 30.0 / 25);
}

TEST(BenchWindows, AUnitOfWorkIsNeverCutInTwo) {
  BenchWindows windows(4, 2);
  EXPECT_FALSE(windows.see(30, 3));
  EXPECT_TRUE(windows.see(50, 5));
  EXPECT_THAT(windows.rates(), ElementsAre(DoubleEq(10), DoubleEq(10)));
}

TEST(BenchWindows, WorkThatTakesLongerThanAWindowMakesFewer) {
  BenchWindows windows(5);
  EXPECT_TRUE(windows.see(14, 7));
  EXPECT_THAT(windows.rates(), ElementsAre(DoubleEq(2)));
}

TEST(BenchWindows, RoundingLeavesNoWindowOpen) {
  for (const double seconds : {0.1, 0.7, 1.1, 20.0, 1e5}) {
    BenchWindows windows(seconds);
    for (int i = 1; i < 5; ++i) EXPECT_FALSE(windows.see(i, seconds * i / 5)) << seconds << " " << i;
    EXPECT_TRUE(windows.see(5, seconds)) << seconds;
    EXPECT_GE(windows.rates().size(), 4u) << seconds;
  }
}

}  // namespace bench_windows_test
}  // namespace comrad
