#include "deploy/evaluation/cross_play.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace cross_play_test {

using ::testing::HasSubstr;

TEST(CrossPlay, PairsTheEpisodesOfAllCells) {
  // Two players that are 4 better with themselves than with each other, in a hard episode and an easy one.
  const CrossPlay result = cross_play_of({"A", "B"}, {{5, 15}, {2, 12}, {0, 10}, {5, 15}});
  EXPECT_DOUBLE_EQ(result.J[0][1].mean, 7);
  EXPECT_DOUBLE_EQ(result.J[1][0].mean, 5);
  EXPECT_DOUBLE_EQ(result.self.mean, 10);
  EXPECT_DOUBLE_EQ(result.cross.mean, 6);
  EXPECT_DOUBLE_EQ(result.gap.mean, 4);
  EXPECT_GT(result.self.ci95, 10);
  EXPECT_NEAR(result.gap.ci95, 0, 1e-9) << "the episode's own luck is not the players' difference";

  const auto json = cross_play_json(result);
  EXPECT_EQ(json["J"], (nlohmann::ordered_json{{10.0, 7.0}, {5.0, 10.0}}));
  EXPECT_EQ(json["gap"]["J_mean"], 4.0);
  EXPECT_EQ(json["J_ci95"].size(), 2u);

  const std::string table = cross_play_table(result);
  EXPECT_THAT(table, HasSubstr("seat 0 \\ others"));
  EXPECT_THAT(table, HasSubstr("cross-play 6 +- "));
  EXPECT_THAT(table, HasSubstr("gap 4 +- 0\n"));
}

}  // namespace cross_play_test
}  // namespace comrad::deploy
