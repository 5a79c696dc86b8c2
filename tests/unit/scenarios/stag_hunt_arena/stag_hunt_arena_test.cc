// Stag Hunt Arena: the stag with its shield, hares, rewards, respawns; layouts; the scripted team.
#include <cmath>

#include "sim_workers/engine/play/placement.h"
#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace stag_hunt_arena_test {

constexpr int32_t kStagId = 200, kHareId = 300;

doom::Actor* stag(PlayedScenario& stage) {
  const auto stags = stage.things(kStagId);
  return stags.size() == 1 ? stags[0] : nullptr;
}
void spare(PlayedScenario& stage) {
  for (std::size_t agent = 0; agent < stage.buttons.size(); ++agent)
    stage.body(static_cast<int>(agent)).set(doom::ActorFlag::kInvulnerable);
}
/// Keeps the stag where it is.
void hold(doom::Actor& actor) { actor.tics = 1'000'000; }

TEST(StagHuntArena, HuntersCarryAShotgunAndNothingElse) {
  PlayedScenario stage("stag_hunt_arena", {.num_agents = 4});
  stage.run(1);
  for (int agent = 0; agent < 4; ++agent) {
    EXPECT_EQ(stage.carried(agent, "Shotgun"), 1);
    EXPECT_EQ(stage.carried(agent, "Shell"), 9999);
    EXPECT_EQ(stage.carried(agent, "Fist") + stage.carried(agent, "Pistol"), 0);
  }
  EXPECT_EQ(place_of(stage.body(0)).x, -64);
  EXPECT_EQ(place_of(stage.body(1)).x, 64);
  EXPECT_EQ(place_of(stage.body(1)).y, -896);
  EXPECT_EQ(place_of(stage.body(3)).y, -832);
}

TEST(StagHuntArena, TheStagComesAtTic175WithItsShieldUp) {
  PlayedScenario stage("stag_hunt_arena");
  stage.run(170);
  EXPECT_EQ(stag(stage), nullptr);
  EXPECT_EQ(stage.user(55), 0);
  stage.run(12);
  ASSERT_NE(stag(stage), nullptr);
  EXPECT_EQ(stage.user(55), 1);
  EXPECT_EQ(stage.user(51), 500);
  EXPECT_TRUE(stag(stage)->has(doom::ActorFlag::kInvulnerable));
}

TEST(StagHuntArena, TheShieldDropsOnlyForTwoHuntersWithin555) {
  PlayedScenario stage("stag_hunt_arena");
  spare(stage);
  stage.run(182);
  ASSERT_NE(stag(stage), nullptr);
  doom::Actor& prey = *stag(stage);
  hold(prey);
  const Place at = place_of(prey);
  stage.put(0, at.x, at.y - 300);
  stage.run(5);
  EXPECT_EQ(stage.user(52), 0) << "one hunter alone";
  stage.put(1, at.x + 560, at.y);
  stage.run(5);
  EXPECT_EQ(stage.user(52), 0);
  stage.put(1, at.x + 550, at.y);
  stage.run(5);
  EXPECT_EQ(stage.user(52), 1);
  EXPECT_FALSE(prey.has(doom::ActorFlag::kInvulnerable));
}

TEST(StagHuntArena, AShieldedStagHealsToItsFullHealthAndNotBeyond) {
  PlayedScenario stage("stag_hunt_arena");
  spare(stage);
  stage.run(182);
  ASSERT_NE(stag(stage), nullptr);
  doom::Actor& prey = *stag(stage);
  hold(prey);
  prey.health = 473;
  stage.run(4);
  EXPECT_EQ(prey.health, 477);
  stage.run(60);
  EXPECT_EQ(prey.health, 500);
  EXPECT_EQ(stage.user(50), 27) << "harm is paid once, healing not";
}

TEST(StagHuntArena, AKillPaysEveryHunterAndTheNextStagComes500TicsLater) {
  PlayedScenario stage("stag_hunt_arena", {.num_agents = 3});
  stage.run(182);
  ASSERT_NE(stag(stage), nullptr);
  stag(stage)->set(doom::ActorFlag::kInvulnerable, false);
  const double before = stage.returns[2];
  stage.hurt(*stag(stage), 5000, 0);
  stage.run(5);
  EXPECT_EQ(stage.user(54), 1);
  EXPECT_EQ(stage.user(55), 0);
  for (int agent = 0; agent < 3; ++agent) EXPECT_EQ(stage.body(agent).health, 150);
  EXPECT_NEAR(stage.returns[2] - before, 50 + 0.005 * 500, 1e-3);
  stage.run(480);
  EXPECT_EQ(stage.user(55), 0);
  int waited = 485;
  while (stage.user(55) == 0 && waited < 1000) waited += stage.run(1);
  // Where a hare stands on its spot, the stag tries again 35 tics later.
  EXPECT_LE((waited - 500) % 36, 12) << waited;
  EXPECT_LT(waited, 700);
}

TEST(StagHuntArena, AStagThatIsNotKilledLeavesAndComesAgain) {
  PlayedScenario stage("stag_hunt_arena");
  spare(stage);
  stage.run(182);
  ASSERT_NE(stag(stage), nullptr);
  hold(*stag(stage));
  stage.run(2440);
  EXPECT_EQ(stage.user(55), 1);
  stage.run(20);
  EXPECT_EQ(stage.user(55), 0);
  EXPECT_EQ(stage.user(54), 0);
  stage.run(205);
  EXPECT_EQ(stage.user(55), 1);
}

TEST(StagHuntArena, HaresAreTwelveAtMostAndPayWhoShootsThem) {
  PlayedScenario stage("stag_hunt_arena");
  spare(stage);
  stage.run(170);
  EXPECT_GE(stage.things(kHareId).size(), 7u);
  stage.run(300);
  ASSERT_EQ(stage.things(kHareId).size(), 12u);
  doom::Actor& hare = *stage.things(kHareId)[0];
  hare.set(doom::ActorFlag::kInvulnerable, false);
  stage.body(1).health = stage.world().state().players[1].health = 50;
  const double before = stage.returns[1];
  stage.hurt(hare, 5, 1);
  stage.run(3);
  EXPECT_EQ(stage.user(53), 1);
  EXPECT_EQ(stage.user(56), 0);
  EXPECT_EQ(stage.user(57), 1);
  EXPECT_EQ(stage.body(1).health, 53);
  EXPECT_NEAR(stage.returns[1] - before, 3, 1e-3);
}

TEST(StagHuntArena, HaresAreVulnerableOnlyNearAHunter) {
  PlayedScenario stage("stag_hunt_arena");
  spare(stage);
  stage.run(60);
  ASSERT_FALSE(stage.things(kHareId).empty());
  // Both hunters into a corner, all hares into the far one.
  stage.put(0, -980, -980), stage.put(1, -920, -980);
  for (doom::Actor* hare : stage.things(kHareId))
    set_position(stage.world(), hare->id, doom::to_fixed(900), doom::to_fixed(900), 0);
  stage.run(20);
  for (doom::Actor* hare : stage.things(kHareId))
    if (place_of(*hare).x > 400 && place_of(*hare).y > 400) {
      EXPECT_TRUE(hare->has(doom::ActorFlag::kInvulnerable));
    }
}

TEST(StagHuntArena, TheDeadComeBackAtOnceWithTheirGear) {
  PlayedScenario stage("stag_hunt_arena");
  stage.run(10);
  stage.hurt(stage.body(0), 1000, -1);
  stage.run(5);
  EXPECT_FALSE(stage.over());
  EXPECT_TRUE(stage.world().player(0).alive);
  EXPECT_EQ(stage.carried(0, "Shell"), 9999);
  EXPECT_EQ(stage.body(0).thing_id, 101);
  EXPECT_LE(stage.returns[0], -2);
}

TEST(StagHuntArenaLayout, ThirtySeedsGiveMaps) {
  for (uint64_t seed = 0; seed < 30; ++seed) {
    const auto layout = scenarios::generate_layout("stag_hunt_arena", {.seed = seed});
    ASSERT_TRUE(layout) << layout.error().message;
    EXPECT_TRUE(layout->warnings.empty());
  }
}

TEST(StagHuntArenaOracle, Kills24Stags) { EXPECT_GE(oracle_mean("stag_hunt_arena", 4), 24); }

TEST(StagHuntArenaOracle, KillsThemInBentWallsToo) {
  EXPECT_GE(oracle_mean("stag_hunt_arena", 4, kVaried), 24);
}

}  // namespace stag_hunt_arena_test
}  // namespace comrad::sim
