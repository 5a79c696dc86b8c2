// Platform Chain: checkpoints, tether, lifts, crushers, panels, endings; the scripted team gets far.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace platform_chain_test {

constexpr const char* kScenario = "platform_chain";
constexpr int kLength = 51, kBreaks = 52, kDragged = 53, kJoint = 54, kCheckpoint = 56;

Place middle_of(int i) {
  const int row = i / 12, column = row % 2 == 0 ? i % 12 : 11 - i % 12;
  return {-990.0 + 180 * column, -270.0 + 180 * row};
}
const doom::Sector* platform(PlayedScenario& game, int i) {
  for (const doom::Sector& sector : game.world().sectors())
    if (sector.tag == 8000 + i) return &sector;
  return nullptr;
}
int first_of(PlayedScenario& game, const char* floor) {
  for (int i = 2; i < 48; ++i)
    if (platform(game, i)->floor_texture == floor) return i;
  return -1;
}
void put_on(PlayedScenario& game, int agent, int i, double dx = 0, double dy = 0) {
  const Place c = middle_of(i);
  game.put(agent, c.x + dx, c.y + dy);
}

TEST(PlatformChain, LevelsCountInTheirOrderAndTheSlowerOneDecides) {
  PlayedScenario game(kScenario);
  game.run(4);
  EXPECT_EQ(game.user(kCheckpoint), 0);
  EXPECT_EQ(game.user(kCheckpoint + 1), 1);
  EXPECT_EQ(game.user(kJoint), 0);
  put_on(game, 0, 1, -30, 30);
  game.returns[0] = 0;
  game.run(2);
  EXPECT_EQ(game.user(kJoint), 1);
  EXPECT_NEAR(game.returns[0], 0.5, 1e-5);
  put_on(game, 1, 3, -40);
  put_on(game, 0, 3, 30);
  game.run(2);
  EXPECT_EQ(game.user(kCheckpoint + 1), 1) << "platform 2 was left out";
}

TEST(PlatformChain, AnOverlongTetherPullsBothTogether) {
  PlayedScenario game(kScenario);
  game.run(6);
  put_on(game, 1, 1, 40);
  put_on(game, 0, 0, -40);
  game.run(6);
  EXPECT_EQ(game.user(kBreaks), 1);
  EXPECT_NEAR(distance_between(place_of(game.body(0)), place_of(game.body(1))), 226, 3);
  EXPECT_NEAR(game.user(kLength) / 65536.0, 226, 40);
}

TEST(PlatformChain, ThirtyLightsShowTheTether) {
  PlayedScenario game(kScenario);
  game.run(8);
  EXPECT_EQ(game.of_type("TetherCalm").size(), 30u);
  put_on(game, 1, 1, 20);
  put_on(game, 0, 0, -20);
  game.run(6);
  EXPECT_EQ(game.of_type("TetherCalm").size(), 0u);
  EXPECT_EQ(game.of_type("TetherWarn").size(), 30u);
}

TEST(PlatformChain, LavaKillsAtOnceAndEndsTheEpisodeForBoth) {
  PlayedScenario game(kScenario);
  game.run(6);
  game.put(0, -990 + 90, -270);
  game.run(5);
  EXPECT_TRUE(game.environment.last_step().terminated);
  EXPECT_NEAR(game.returns[0], -1, 0.06);
  EXPECT_NEAR(game.returns[1], 0, 0.06);
  EXPECT_EQ(game.environment.summary().score, 0);
}

TEST(PlatformChain, ALiftGoesUp152AndComesBack) {
  PlayedScenario game(kScenario);
  game.run(4);
  const int lift = first_of(game, "FLAT14");
  ASSERT_GE(lift, 0);
  int low = 9999, high = -9999;
  for (int tic = 0; tic < 700; ++tic) {
    game.run(1);
    const int height = platform(game, lift)->floor_height / 65536 - 12 * lift;
    low = std::min(low, height), high = std::max(high, height);
  }
  EXPECT_EQ(low, 0);
  EXPECT_EQ(high, 152);
}

TEST(PlatformChain, ACrusherComesDownNearlyToTheFloorAndKills) {
  PlayedScenario game(kScenario, {.episode_seed = 3});
  game.run(4);
  const int crusher = first_of(game, "BLOOD1");
  ASSERT_GE(crusher, 0);
  double least = 9999;
  for (int tic = 0; tic < 300; ++tic) {
    game.run(1);
    const doom::Sector& sector = *platform(game, crusher);
    least = std::min(least, doom::to_double(sector.ceiling_height - sector.floor_height));
  }
  EXPECT_LE(least, 8);
  ASSERT_FALSE(game.over());
  put_on(game, 0, crusher, -30);
  put_on(game, 1, crusher, 30);
  game.run(900);
  EXPECT_TRUE(game.environment.last_step().terminated);
}

TEST(PlatformChain, EightPanelsSwingAndComeBack) {
  PlayedScenario game(kScenario);
  game.run(2);
  const auto& panels = game.world().state().movers.polyobjects;
  ASSERT_EQ(panels.size(), 8u);
  constexpr doom::Fixed kStart = (-270 + 20) * 65536;
  game.run(150);
  EXPECT_EQ((panels[0].y - kStart) / 65536, -128) << "the first one goes south";
  game.run(198);
  EXPECT_EQ(panels[0].y, kStart);
}

TEST(PlatformChain, ScriptedTeamGetsBeyondTheFirstRow) { EXPECT_GT(oracle_mean(kScenario, 8), 12); }

TEST(PlatformChain, ScriptedTeamGetsAsFarOnVariedMaps) { EXPECT_GT(oracle_mean(kScenario, 8, kVaried), 12); }

TEST(PlatformChain, ThirtySeedsGiveValidLayouts) {
  for (uint64_t seed = 0; seed < 30; ++seed)
    EXPECT_TRUE(scenarios::generate_layout(kScenario, {.seed = seed}));
  for (const char* levels : {"36", "60"})
    EXPECT_TRUE(
        scenarios::generate_layout(kScenario, {.parameters = {{"levels", levels}, {"panels", "12"}}}));
}

}  // namespace platform_chain_test
}  // namespace comrad::sim
