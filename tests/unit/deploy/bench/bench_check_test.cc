#include "deploy/bench/bench_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace bench_check_test {

using nlohmann::ordered_json;

ordered_json part(double seconds) { return {{"cpu_seconds_per_1000_decisions", {{"all", seconds}}}}; }

ordered_json train(double decisions, double others) {
  return {{"cores", 2}, {"seconds", 10.0}, {"decisions", decisions}, {"other_programs_busy", others}};
}

TEST(ShareOfLimit, IsWhatThePartsCostAloneOverTheFreeCoreSeconds) {
  const std::vector<ordered_json> parts = {part(0.1), part(0.2), part(0.7)};
  EXPECT_DOUBLE_EQ(share_of_limit(parts, train(20'000, 0)), 1) << "one second a thousand, 20 core seconds";
  EXPECT_DOUBLE_EQ(share_of_limit(parts, train(10'000, 0)), 0.5);
  EXPECT_DOUBLE_EQ(share_of_limit(parts, train(10'000, 0.5)), 1) << "others had half of the cores";
}

TEST(BenchBound, HoldsByTheMedianOfItsRounds) {
  BenchBound least{.name = "a", .bound = 0.85, .is_at_most = false, .how = ""};
  EXPECT_FALSE(least.holds()) << "nothing was measured";
  least.measured = {0.2, 0.9, 0.86};
  EXPECT_TRUE(least.holds());
  least.measured = {0.2, 0.9, 0.84};
  EXPECT_FALSE(least.holds());
  BenchBound most{.name = "b", .bound = 1.15, .is_at_most = true, .how = "", .measured = {9, 1.15, 1.1}};
  EXPECT_TRUE(most.holds());
  most.measured = {9, 1.16, 1.1};
  EXPECT_FALSE(most.holds());
}

TEST(BenchBounds, AllSayHowTheyAreMeasured) {
  const std::vector<BenchBound> bounds = bench_bounds(27648);
  ASSERT_EQ(bounds.size(), 4u);
  for (const BenchBound& bound : bounds) {
    EXPECT_FALSE(bound.name.empty());
    EXPECT_FALSE(bound.how.empty()) << bound.name;
    EXPECT_FALSE(bound.holds()) << bound.name;
  }
}

}  // namespace bench_check_test
}  // namespace comrad::deploy
