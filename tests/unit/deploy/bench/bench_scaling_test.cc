#include "deploy/bench/bench_scaling.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace bench_scaling_test {

using nlohmann::ordered_json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;

TEST(ScalingGrid, OfNothingIsOnePointAsTheSettingsHaveIt) {
  const auto points = ScalingGrid{.benches = {"sim"}}.points();
  ASSERT_EQ(points.size(), 1u);
  EXPECT_EQ(points[0].bench, "sim");
  EXPECT_THAT(points[0].settings, IsEmpty());
}

TEST(ScalingGrid, HoldsEveryCombinationWithAgentsChangingFirst) {
  const auto points = ScalingGrid{
      .benches = {"train"},
      .scenarios = {"a", "b"},
      .agents = {"2", "4"},
      .workers = {"1"}}.points();
  ASSERT_EQ(points.size(), 4u);
  EXPECT_THAT(points[1].settings,
              ElementsAre(Pair("scenario", "a"), Pair("num_workers", "1"), Pair("num_agents", "4")));
  EXPECT_THAT(points[2].settings,
              ElementsAre(Pair("scenario", "b"), Pair("num_workers", "1"), Pair("num_agents", "2")));
}

TEST(ScalingGrid, WorkersVaryOnlyWhereThereAreSeveral) {
  const auto points = ScalingGrid{.benches = {"sim", "train"}, .workers = {"1", "2"}}.points();
  ASSERT_EQ(points.size(), 3u);
  EXPECT_EQ(points[0].bench, "sim");
  EXPECT_THAT(points[0].settings, IsEmpty());
  EXPECT_THAT(points[2].settings, ElementsAre(Pair("num_workers", "2")));
}

TEST(CompareCosts, IsSecondsADecisionOverThoseOfTheFirstRowOfTheSameKind) {
  const auto row = [](const char* bench, int agents, double rate) {
    return ordered_json{{"bench", bench},   {"scenario", "s"},          {"num_agents", agents},
                        {"num_workers", 1}, {"num_envs_per_worker", 8}, {"decisions_per_s", rate}};
  };
  ordered_json rows = {row("sim", 2, 1000), row("train", 2, 400), row("sim", 8, 800), row("train", 8, 500)};
  compare_costs(rows);
  EXPECT_EQ(rows[0]["cost_of_an_agent"], 1.0);
  EXPECT_EQ(rows[1]["cost_of_an_agent"], 1.0);
  EXPECT_EQ(rows[2]["cost_of_an_agent"], 1.25);
  EXPECT_EQ(rows[3]["cost_of_an_agent"], 0.8);
}

TEST(MeasureScaling, RefusesAPartThatIsNoBench) {
  const auto refused = measure_scaling({.benches = {"sim", "replay"}}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("'replay'"));
}

TEST(WithSettings, TheLaterOfTwoWins) {
  const UserSettings user = user_with({"", {"command line", {{"seed", "1"}, {"algo", "vdn"}}}},
                                      {{"algo", "ippo"}, {"rollout", "8"}});
  EXPECT_THAT(user.typed.values, ElementsAre(Pair("seed", "1"), Pair("algo", "ippo"), Pair("rollout", "8")));
}

}  // namespace bench_scaling_test
}  // namespace comrad::deploy
