// Co-op Puzzle: plates, doors, sync rooms, rewards and endings; the scripted team solves it.
#include <gtest/gtest.h>

#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace coop_puzzle_test {

constexpr const char* kScenario = "coop_puzzle";
constexpr int kTeamBest = 1, kEngaged = 2, kSyncRoom = 3, kZones = 6, kSucceeded = 7, kPairs = 8;

double opening(PlayedScenario& game, int tag) {
  for (const doom::Sector& sector : game.world().sectors())
    if (sector.tag == tag) return doom::to_double(sector.ceiling_height - sector.floor_height);
  return -1;
}
/// The lane of the lit plate of a zone (0 A, 1 B, -1 none), and where it lies.
int lit_plate(PlayedScenario& game, int zone, Place* place) {
  int found = -1;
  for (const doom::Sector& sector : game.world().sectors())
    for (int lane = 0; lane < 2; ++lane)
      for (int index = 0; index < 2; ++index)
        if (sector.tag == zone * 1000 + (lane == 0 ? 1 : 101) + index &&
            sector.floor_texture.starts_with("AQF")) {
          EXPECT_EQ(found, -1) << "one lit plate for each zone";
          EXPECT_EQ(sector.floor_texture, lane == 0 ? "AQF044" : "AQF038");
          found = lane;
          *place = {384.0 * (zone - 1) - 192 + 128 * (index + 1), lane == 0 ? 162.0 : -162.0};
        }
  return found;
}

TEST(CoopPuzzle, EveryPairLightsAPlateInEachZoneOnOppositeSidesButTheSyncPair) {
  for (uint64_t seed = 0; seed < 5; ++seed) {
    PlayedScenario game(kScenario, {.episode_seed = seed});
    game.run(6);
    EXPECT_EQ(game.user(kZones), 10);
    for (int pair = 1; pair <= 5; ++pair) {
      Place place;
      const int odd = lit_plate(game, 2 * pair - 1, &place), even = lit_plate(game, 2 * pair, &place);
      if (pair == 4) {
        EXPECT_EQ(odd, -1);
        EXPECT_EQ(even, -1);
      } else {
        EXPECT_GE(odd, 0);
        EXPECT_EQ(even, 1 - odd);
      }
    }
  }
}

TEST(CoopPuzzle, ALitPlateOpensTheOtherLanesDoorWhileItIsHeld) {
  PlayedScenario game(kScenario);
  game.run(8);
  Place plate;
  const int lane = lit_plate(game, 1, &plate);
  game.put(lane, plate.x, plate.y);
  game.run(8);
  EXPECT_EQ(game.user(kEngaged), 1);
  const int own = lane == 0 ? 1 : 51, other = lane == 0 ? 51 : 1;
  EXPECT_GE(opening(game, other), 56) << "passable after 7 tics";
  EXPECT_EQ(opening(game, own), 0);
  game.run(20);
  EXPECT_EQ(opening(game, other), 124);
  game.put(lane, plate.x - 100, plate.y);
  game.run(20);
  EXPECT_EQ(opening(game, other), 0) << "no latch";
}

TEST(CoopPuzzle, ADoorIsNotSentDownOntoABody) {
  PlayedScenario game(kScenario);
  game.run(8);
  Place plate;
  const int lane = lit_plate(game, 1, &plate), other = 1 - lane;
  game.put(lane, plate.x, plate.y);
  game.run(20);
  game.put(other, 176, other == 0 ? 120 : -120);  // under the door
  game.put(lane, plate.x - 100, plate.y);
  game.run(60);
  EXPECT_EQ(opening(game, other == 0 ? 1 : 51), 124);
  EXPECT_EQ(game.body(other).health, 100);
}

TEST(CoopPuzzle, TheSyncRoomRequiresBothAtOnceAndStaysOpenForThreeSeconds) {
  PlayedScenario game(kScenario);
  game.run(8);
  const double x = 384.0 * 6 - 192 + 128;
  game.put(0, x, 162);
  game.run(20);
  EXPECT_EQ(opening(game, 4), 0) << "one alone opens nothing";
  EXPECT_EQ(game.user(kSyncRoom), 1);
  game.put(1, x, -162);
  game.run(3);
  game.put(0, x + 100, 60);
  game.run(20);
  EXPECT_EQ(opening(game, 4), 124);
  EXPECT_EQ(opening(game, 54), 124);
  game.run(75);
  EXPECT_EQ(opening(game, 4), 124);
  game.run(40);
  EXPECT_EQ(opening(game, 4), 0);
}

TEST(CoopPuzzle, PairsCountTheSlowerAgentAndTheTeamIsPaidHalfEach) {
  PlayedScenario game(kScenario);
  game.run(8);
  game.returns[0] = 0;
  game.put(0, 384, 120);
  game.run(2);
  EXPECT_EQ(game.user(kTeamBest), 2);
  EXPECT_EQ(game.user(kPairs), 0);
  game.put(1, 384, -120);
  game.run(2);
  EXPECT_EQ(game.user(kPairs), 1);
  EXPECT_NEAR(game.returns[0], (0.75 + 1.0) / 2 - 4 * 0.001, 1e-5);
}

TEST(CoopPuzzle, BothInTheLastZoneEndTheEpisodeEvenOnAPlate) {
  PlayedScenario game(kScenario);
  game.run(8);
  EXPECT_NEAR(game.returns[0], -8 * 0.001, 1e-5) << "the first zone pays nothing";
  Place plate;
  const int lane = lit_plate(game, 10, &plate);
  game.put(lane, plate.x, plate.y);
  game.put(1 - lane, 384 * 9, lane == 0 ? -120 : 120);
  game.run(3);
  EXPECT_TRUE(game.environment.last_step().terminated);
  EXPECT_EQ(game.user(kSucceeded), 1);
  EXPECT_EQ(game.environment.summary().score, 5);
}

TEST(CoopPuzzle, TheTimeLimitCostsOneForTheTeam) {
  PlayedScenario game(kScenario, {.frame_skip = 4});
  game.run(2000);
  EXPECT_TRUE(game.environment.last_step().truncated);
  EXPECT_EQ(game.environment.summary().length_tics, 8000u);
  EXPECT_NEAR(game.returns[0], -2000 * 0.001 - 0.5, 1e-3);
}

TEST(CoopPuzzle, ScriptedTeamSolvesAllPairs) { EXPECT_EQ(oracle_mean(kScenario, 4), 5); }

TEST(CoopPuzzle, ScriptedTeamSolvesAllPairsOnVariedMapsToo) {
  EXPECT_EQ(oracle_mean(kScenario, 8, kVaried), 5);
}

TEST(CoopPuzzle, ThirtySeedsGiveValidLayoutsAndSoDoesEveryWidth) {
  for (uint64_t seed = 0; seed < 30; ++seed)
    EXPECT_TRUE(scenarios::generate_layout(kScenario, {.seed = seed}));
  for (const char* gap : {"0", "32", "64"})
    EXPECT_TRUE(scenarios::generate_layout(
        kScenario, {.parameters = {{"gap", gap}, {"plates", "3"}, {"plate_size", "56"}}}));
}

}  // namespace coop_puzzle_test
}  // namespace comrad::sim
