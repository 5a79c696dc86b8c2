// Lava Maze: the path, the signals, the ring, rewards and endings; the scripted team clears all levels.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace lava_maze_test {

constexpr const char* kScenario = "lava_maze";
constexpr int kGoalX = 13, kCellX = 14, kCellY = 15, kSignal = 16, kFlash = 17, kGoalY = 18, kLevels = 22,
              kSteps = 28, kFlashes = 29, kMerit = 31, kVain = 33, kPathCells = 34;

bool is_open(PlayedScenario& game, int cell) { return (game.user(19 + cell / 27) >> cell % 27 & 1) != 0; }
int floor_of(PlayedScenario& game, int cell) {
  for (const doom::Sector& sector : game.world().sectors())
    if (sector.tag == 100 + cell) return sector.floor_height / 65536;
  return 9999;
}
Place middle_of(int x, int y) { return {-512.0 + 128 * x + 64, -512.0 + 128 * y + 64}; }
void stand_on_goal(PlayedScenario& game) {
  const Place goal = middle_of(game.user(kGoalX), game.user(kGoalY));
  game.put(0, goal.x, goal.y);
}

/// The colour of the side towards which the goal lies on a path of one hop, two cells; 0 of any other path.
int colour_of_the_hop(PlayedScenario& game) {
  const int dx = game.user(kGoalX) - game.user(kCellX), dy = game.user(kGoalY) - game.user(kCellY);
  if (std::abs(dx) + std::abs(dy) != 2) return 0;
  return dx > 0 ? 1 : dy > 0 ? 3 : dx < 0 ? 2 : 4;
}

TEST(LavaMaze, FirstPathHasNineCellsAndOnlyItRises) {
  for (uint64_t seed = 0; seed < 8; ++seed) {
    PlayedScenario game(kScenario, {.episode_seed = seed});
    game.run(6);
    EXPECT_EQ(game.user(kPathCells), 9);
    int open = 0;
    for (int cell = 0; cell < 64; ++cell) {
      open += is_open(game, cell);
      EXPECT_EQ(floor_of(game, cell), is_open(game, cell) ? 0 : -64) << "cell " << cell;
    }
    EXPECT_EQ(open, 9);
    EXPECT_TRUE(is_open(game, game.user(kCellY) * 8 + game.user(kCellX)))
        << "the navigator stands on the path";
    EXPECT_EQ(game.body(0).health, 100);
  }
}

TEST(LavaMaze, ReachingTheGoalPaysTenAndMakesALongerPath) {
  PlayedScenario game(kScenario);
  game.run(6);
  stand_on_goal(game);
  game.returns[0] = game.returns[1] = 0;
  game.run(2);
  EXPECT_EQ(game.user(kLevels), 1);
  EXPECT_EQ(game.user(kPathCells), 11);
  EXPECT_NEAR(game.returns[0], 10.0 + 0.5 * game.user(kSteps) - 0.005 * 2, 1e-4);
  EXPECT_FALSE(game.over());
}

TEST(LavaMaze, SixthGoalEndsTheEpisodeAndIsCounted) {
  PlayedScenario game(kScenario);
  game.run(6);
  for (int level = 1; level <= 6; ++level) {
    ASSERT_FALSE(game.over());
    stand_on_goal(game);
    game.run(4);
    EXPECT_EQ(game.user(kLevels), level);
  }
  EXPECT_TRUE(game.environment.last_step().terminated);
  EXPECT_EQ(game.environment.summary().score, 6);
}

TEST(LavaMaze, EachLampFlashesItsColourForTwentyFiveTicsAndAllTakeForty) {
  for (int slot = 1; slot <= 4; ++slot) {
    PlayedScenario game(kScenario);
    game.run(8);
    game.buttons[1].select_weapon = static_cast<int8_t>(slot);
    game.buttons[1].attack = true;
    game.run(4);
    ASSERT_EQ(game.user(kSignal), slot) << "slots: green, red, yellow, blue";
    const std::vector<float> seen = game.measurements();
    for (int k = 0; k < 4; ++k) EXPECT_EQ(seen[static_cast<std::size_t>(2 + k)], k + 1 == slot);
    EXPECT_EQ(seen[1], 0);
    EXPECT_EQ(seen[6], 1);
    int lit = 0, tics = 0;
    game.buttons[1].select_weapon = -1;
    while (game.user(kFlashes) < 2 && tics < 60)
      game.run(1), ++tics, lit += game.user(kFlash) != 0 && game.user(kFlashes) == 1;
    EXPECT_GE(lit, 22);
    EXPECT_LE(lit, 25);
    EXPECT_GE(tics, 36) << "cooldown of 40 tics, the four that were played included";
    EXPECT_LE(tics, 41);
  }
}

TEST(LavaMaze, AGuideShowsTheColourOfTheWayWhateverLampFlashes) {
  int right = 0, corrected = 0;
  for (uint64_t seed = 0; seed < 24; ++seed) {
    SCOPED_TRACE(seed);
    PlayedScenario game(
        kScenario, {.episode_seed = seed,
                    .parameters = {{"guide", "100"}, {"wait", "8"}, {"initial", "3"}, {"maximum", "4"}}});
    game.run(8);
    game.buttons[1].select_weapon = 1;
    game.buttons[1].attack = true;
    while (game.user(kFlashes) == 0) ASSERT_EQ(game.run(1), 1);
    const int colour = colour_of_the_hop(game);
    ASSERT_NE(colour, 0);
    EXPECT_EQ(game.user(kSignal), colour);
    right += game.user(kSignal) == colour, corrected += colour != 1;
    game.run(25);
    EXPECT_EQ(game.user(kSignal), 0) << "a corrected flash ends as any other";
    while (game.user(kFlashes) == 1) ASSERT_EQ(game.run(1), 1);
    EXPECT_EQ(game.user(kSignal), colour) << "the navigator has not moved";
  }
  EXPECT_EQ(right, 24);
  EXPECT_GE(corrected, 8);
}

TEST(LavaMaze, AHalfGuideLeavesHalfOfTheLampsAlone) {
  PlayedScenario game(kScenario, {.parameters = {{"guide", "50"}, {"initial", "3"}, {"maximum", "4"}}});
  game.run(8);
  const int colour = colour_of_the_hop(game);
  const int other = colour % 4 + 1;
  game.buttons[1].select_weapon = static_cast<int8_t>(other);
  game.buttons[1].attack = true;
  int shown = 0, own = 0;
  for (int flash = 0; flash < 200; ++flash) {
    const int before = game.user(kFlashes);
    while (game.user(kFlashes) == before) ASSERT_EQ(game.run(1), 1);
    shown += game.user(kSignal) == colour, own += game.user(kSignal) == other;
  }
  EXPECT_EQ(shown + own, 200);
  EXPECT_NEAR(shown, 100, 30);  // more than four standard deviations
}

TEST(LavaMaze, AWaitKeepsTheFirstFlashBack) {
  PlayedScenario game(kScenario, {.parameters = {{"wait", "100"}}});
  game.buttons[1].attack = true;
  game.run(95);
  EXPECT_EQ(game.user(kFlashes), 0);
  while (game.user(kFlashes) == 0) ASSERT_EQ(game.run(1), 1);
  int tics = 0;
  for (; game.user(kFlashes) == 1; ++tics) ASSERT_EQ(game.run(1), 1);
  EXPECT_NEAR(tics, 40, 2) << "later ones come as ever";
}

TEST(LavaMaze, AFlashWithoutStepsIsHeldAgainstTheSignalerAlone) {
  PlayedScenario game(kScenario);
  game.run(8);
  game.buttons[1].attack = true;
  game.run(3);
  game.buttons[1].attack = false;
  game.returns[0] = game.returns[1] = 0;
  game.run(130);
  EXPECT_EQ(game.user(kVain), 1);
  EXPECT_EQ(game.user(kMerit), 0);
  EXPECT_NEAR(game.returns[1] - game.returns[0], -0.005, 1e-5);
}

TEST(LavaMaze, LavaKillsWithinNinetySixTicsAndEndsTheEpisode) {
  PlayedScenario game(kScenario);
  game.run(6);
  int lava = 0;
  while (is_open(game, lava)) ++lava;
  const Place place = middle_of(lava % 8, lava / 8);
  game.put(0, place.x, place.y);
  game.run(120);
  EXPECT_TRUE(game.environment.last_step().terminated);
  EXPECT_LE(game.environment.summary().length_tics, 6u + 98u);
  EXPECT_LT(game.returns[0], game.returns[1] - 5) << "own death and own health count for the navigator alone";
}

TEST(LavaMaze, SignalerRidesOppositeToTheNavigatorAndLooksAtIt) {
  PlayedScenario game(kScenario);
  game.run(220);
  const Place navigator = place_of(game.body(0)), signaler = place_of(game.body(1));
  EXPECT_NEAR(std::max(std::abs(signaler.x), std::abs(signaler.y)), 626, 2);
  EXPECT_LT(signaler.x * navigator.x + signaler.y * navigator.y, 0) << "the other side of the middle";
  EXPECT_NEAR(wrap_degrees(bearing_degrees(signaler, navigator) - angle_degrees(game.body(1))), 0, 2);
}

TEST(LavaMaze, MasksGiveEachRoleItsOwnHalfOfTheActions) {
  PlayedScenario game(kScenario);
  std::vector<uint8_t> mask(26);
  game.environment.observe_numbers({.action_mask = mask.data()});
  const std::vector<uint8_t> expected = {1, 1, 1, 1, 1, 1, 1, 0, 1, 0, 0, 0, 0,
                                         1, 0, 0, 1, 0, 0, 1, 1, 1, 1, 1, 1, 1};
  EXPECT_EQ(mask, expected);
}

TEST(LavaMaze, ScriptedTeamClearsSixLevels) { EXPECT_EQ(oracle_mean(kScenario, 4), 6); }

TEST(LavaMaze, ScriptedTeamClearsSixLevelsOnVariedMapsToo) {
  EXPECT_EQ(oracle_mean(kScenario, 8, kVaried), 6);
}

TEST(LavaMaze, PathsGoRoundRocksAndKeepTheirSize) {
  constexpr int kFirstOpenBits = 19, kBits = 27;
  int rocks = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    PlayedScenario game(kScenario, {.layout_seed = seed,
                                    .episode_seed = seed,
                                    .parameters = {{"variety", "1"}, {"initial", "20"}, {"maximum", "25"}}});
    game.run(3);
    EXPECT_EQ(game.user(kPathCells), 21);
    for (const doom::Sector& sector : game.world().sectors()) {
      const int cell = sector.tag - 100;
      if (cell < 0 || cell >= 64 || sector.floor_texture != "RROCK10") continue;
      ++rocks;
      EXPECT_EQ(doom::to_double(sector.floor_height), 32) << "it neither sinks nor rises";
      EXPECT_EQ(game.user(kFirstOpenBits + cell / kBits) >> cell % kBits & 1, 0) << "no path crosses it";
    }
  }
  EXPECT_GT(rocks, 10);
}

TEST(LavaMaze, ThirtySeedsGiveValidLayouts) {
  for (uint64_t seed = 0; seed < 30; ++seed)
    EXPECT_TRUE(scenarios::generate_layout(kScenario, {.seed = seed}));
}

}  // namespace lava_maze_test
}  // namespace comrad::sim
