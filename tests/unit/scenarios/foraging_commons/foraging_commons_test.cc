// Foraging Commons: hunger, harvest, cleanup, decay; the scripted team lives long.
#include <gtest/gtest.h>

#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace foraging_commons_test {

constexpr const char* kScenario = "foraging_commons";
constexpr int kRate = 1, kHarvests = 2, kCleanups = 3, kOwnHarvests = 4, kOwnCleanups = 8, kProgress = 12,
              kOthers = 16;

/// Far from every bonus.
void stay_away(PlayedScenario& game, int agent) { game.put(agent, agent * 60 - 30, -900); }
void put_into_station(PlayedScenario& game, int agent) { game.put(agent, agent * 60 - 30, -1200); }

TEST(ForagingCommons, WhoNeverEatsDiesAtTheFiftiethDrain) {
  PlayedScenario game(kScenario);
  game.run(1);
  for (int agent = 0; agent < 2; ++agent) stay_away(game, agent);
  game.run(3000);
  EXPECT_TRUE(game.environment.last_step().terminated);
  EXPECT_NEAR(game.environment.summary().score, 1822, 3);
  EXPECT_NEAR(game.returns[0], -1, 1e-5);
  EXPECT_NEAR(game.returns[1], -1, 1e-5) << "both starve in the same drain";
}

TEST(ForagingCommons, ABonusHealsTwoAndCostsTwoOfTheRate) {
  PlayedScenario game(kScenario);
  int guard = 0;
  while (game.of_type("ForageBonus").empty() && guard++ < 400) game.run(1);
  ASSERT_FALSE(game.of_type("ForageBonus").empty());
  const doom::Actor& bonus = *game.of_type("ForageBonus").front();
  const int rate = game.user(kRate), health = game.body(0).health;
  game.put(0, doom::to_double(bonus.x) - 40, doom::to_double(bonus.y));
  game.look(0, 0);
  game.buttons[0].forward = true;
  game.returns[0] = game.returns[1] = 0;
  for (int i = 0; i < 20 && game.user(kHarvests) == 0; ++i) game.run(1);
  EXPECT_EQ(game.user(kHarvests), 1);
  EXPECT_EQ(game.user(kOwnHarvests), 1);
  EXPECT_EQ(game.user(kOwnHarvests + 1), 0);
  EXPECT_GE(game.user(kRate), rate - 3);
  EXPECT_LE(game.user(kRate), rate - 2);
  EXPECT_NEAR(game.body(0).health, health + 2, 2) << "a drain may fall in between";
  EXPECT_NEAR(game.returns[0], 0.03, 1e-5);
  EXPECT_NEAR(game.returns[1], 0, 1e-6);
}

TEST(ForagingCommons, TheFullLeaveBonusesAlone) {
  PlayedScenario game(kScenario);
  int guard = 0;
  while (game.of_type("ForageBonus").empty() && guard++ < 400) game.run(1);
  const doom::Actor& bonus = *game.of_type("ForageBonus").front();
  game.world().state().players[0].health = game.body(0).health = 200;
  game.put(0, doom::to_double(bonus.x) - 40, doom::to_double(bonus.y));
  game.look(0, 0);
  game.buttons[0].forward = true;
  game.run(8);
  EXPECT_EQ(game.user(kHarvests), 0);
}

TEST(ForagingCommons, ACleanupTakesEighteenPollsAndOnlyOneForEachVisit) {
  PlayedScenario game(kScenario);
  game.run(36);
  put_into_station(game, 0);
  stay_away(game, 1);
  const int rate = game.user(kRate);
  game.run(60);
  EXPECT_GT(game.user(kProgress), 40);
  EXPECT_EQ(game.user(kCleanups), 0);
  game.run(20);
  EXPECT_EQ(game.user(kCleanups), 1);
  EXPECT_EQ(game.user(kOwnCleanups), 1);
  EXPECT_EQ(game.user(kOthers), 0);
  EXPECT_EQ(game.user(kOthers + 1), 1) << "the partner sees it as one by others";
  EXPECT_EQ(game.user(kRate), rate + 15);
  EXPECT_NEAR(game.returns[0], 0.03, 1e-5);
  game.run(200);
  EXPECT_EQ(game.user(kCleanups), 1) << "it must leave first";
  stay_away(game, 0);
  game.run(5);
  put_into_station(game, 0);
  game.run(80);
  EXPECT_EQ(game.user(kCleanups), 2);
}

TEST(ForagingCommons, LeavingEarlyLosesTheProgress) {
  PlayedScenario game(kScenario);
  game.run(36);
  put_into_station(game, 0);
  game.run(50);
  stay_away(game, 0);
  game.run(5);
  EXPECT_EQ(game.user(kProgress), 0);
}

TEST(ForagingCommons, TheRateDecaysByOneEveryThirdPass) {
  PlayedScenario game(kScenario);
  game.run(1);
  for (int agent = 0; agent < 2; ++agent) stay_away(game, agent);
  game.run(105 + 45 * 10);
  EXPECT_NEAR(game.user(kRate), 80 - 10, 1);
}

TEST(ForagingCommons, FourAgentsPlayAndAreCounted) {
  PlayedScenario game(kScenario, {.num_agents = 4});
  game.run(50);
  game.put(3, 0, -1200);
  game.run(90);
  EXPECT_EQ(game.user(kOwnCleanups + 3), 1);
  EXPECT_EQ(game.measurements().size(), 32u);
}

TEST(ForagingCommons, ScriptedTeamLivesBeyondTenThousandTics) { EXPECT_GT(oracle_mean(kScenario, 2), 10000); }

TEST(ForagingCommons, ThirtySeedsGiveValidLayouts) {
  for (uint64_t seed = 0; seed < 30; ++seed)
    EXPECT_TRUE(scenarios::generate_layout(kScenario, {.seed = seed}));
}

}  // namespace foraging_commons_test
}  // namespace comrad::sim
