#include "rollout_buffer/link/trajectories/weights_pace.h"

#include <gtest/gtest.h>

namespace comrad::link {
namespace weights_pace_test {

constexpr std::size_t kMegabyte = 1'000'000;
const WeightsLimits kLimits{.versions_per_s = 10, .bytes_per_s = 50e6, .cpu_share = 0.05, .most_s = 5};

TEST(WeightsPace, TheFirstVersionIsDueAtOnce) {
  const WeightsPace pace(kLimits);
  EXPECT_TRUE(pace.is_due(0, 1));
  EXPECT_TRUE(pace.is_due(1000, 64));
}

TEST(WeightsPace, CheapOnesGoTenTimesASecond) {
  WeightsPace pace(kLimits);
  pace.sent(100, 1000, 1, 1e-5);
  EXPECT_FALSE(pace.is_due(100.09, 1));
  EXPECT_TRUE(pace.is_due(100.11, 1));
  EXPECT_DOUBLE_EQ(pace.since_sent_s(103), 3);
}

TEST(WeightsPace, ManyBytesGoLessOften) {
  WeightsPace pace(kLimits);
  pace.sent(100, 10 * kMegabyte, 1, 0);
  EXPECT_DOUBLE_EQ(pace.interval_s(1), 0.2);
  EXPECT_DOUBLE_EQ(pace.interval_s(4), 0.8);  // three have come since
}

TEST(WeightsPace, ProcessorTimeStaysWithinItsShare) {
  WeightsPace pace(kLimits);
  double now_s = 0, cpu_s = 0;
  int versions = 0;
  for (; now_s < 1000; now_s += 0.005)
    if (pace.is_due(now_s, 2)) {
      pace.sent(now_s, kMegabyte, 2, 0.06);
      cpu_s += 0.06;
      ++versions;
    }
  EXPECT_LE(cpu_s / now_s, 0.0501);
  EXPECT_GE(versions, 825);  // one in 1.2 s
}

TEST(WeightsPace, HoweverMuchTheyCostTheyGoInTheEnd) {
  WeightsPace pace(kLimits);
  pace.sent(100, kMegabyte, 1, 30);
  EXPECT_FALSE(pace.is_due(104.9, 64));
  EXPECT_TRUE(pace.is_due(105, 64));
}

}  // namespace weights_pace_test
}  // namespace comrad::link
