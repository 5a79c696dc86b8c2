// Ammo Carrier: both roles, the exchange of bullets, supplies, monsters, endings; layouts; the scripted team.
#include <cmath>
#include <set>

#include "sim_workers/engine/play/spawning.h"
#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace ammo_carrier_test {

constexpr int kDefender = 0, kRunner = 1;
constexpr int32_t kMonsterId = 700;

void spare(PlayedScenario& stage) {
  for (int agent = 0; agent < 2; ++agent) stage.body(agent).set(doom::ActorFlag::kInvulnerable);
}

doom::Actor& add_monster(PlayedScenario& stage, const char* type, double x, double y) {
  const auto id =
      spawn_actor(stage.world(), *stage.world().catalog().find(type), static_cast<doom::Fixed>(x * 65536),
                  static_cast<doom::Fixed>(y * 65536), 0, 0, kMonsterId);
  return *stage.world().actor(id.value_or(0));
}

TEST(AmmoCarrier, RolesBeginWithTheirGear) {
  PlayedScenario stage("ammo_carrier");
  stage.run(1);
  EXPECT_EQ(stage.body(kDefender).health, 200);
  EXPECT_EQ(stage.carried(kDefender, "Clip"), 50);
  EXPECT_EQ(stage.carried(kDefender, "Chaingun"), 1);
  EXPECT_EQ(stage.world().player(kDefender).armor, 100);
  EXPECT_EQ(place_of(stage.body(kDefender)).x, 0);
  EXPECT_EQ(stage.body(kRunner).health, 100);
  EXPECT_EQ(stage.carried(kRunner, "Clip"), 0);
  EXPECT_EQ(stage.carried(kRunner, "Fist") + stage.carried(kRunner, "Pistol"), 0);
  EXPECT_GT(place_of(stage.body(kRunner)).x, 600) << "in the depot";
}

TEST(AmmoCarrier, TheDefenderNeverMoves) {
  PlayedScenario stage("ammo_carrier");
  stage.buttons[kDefender] = {.forward = true, .left = true};
  stage.run(60);
  EXPECT_LT(distance_between(place_of(stage.body(kDefender)), {0, 0}), 1);
}

TEST(AmmoCarrier, TheRunnerIsHalfAsFastAgain) {
  PlayedScenario stage("ammo_carrier");
  stage.run(2);
  stage.put(kRunner, -330, -150);
  stage.look(kRunner, 0);
  stage.buttons[kRunner].forward = true;
  stage.run(40);
  const double before = place_of(stage.body(kRunner)).x;
  stage.run(1);
  EXPECT_NEAR(place_of(stage.body(kRunner)).x - before, 12.5, 0.4);
}

TEST(AmmoCarrier, BulletsChangeHandsWithin256Units) {
  PlayedScenario stage("ammo_carrier");
  stage.run(2);
  stage.put(kRunner, 0, 270);
  stage.give(kRunner, "Clip", 30);
  stage.run(12);
  EXPECT_EQ(stage.user(42), 0) << "270 units are too far";
  EXPECT_EQ(stage.user(50), 30);
  EXPECT_EQ(stage.user(52), 30) << "bullets picked up";
  stage.put(kRunner, 0, 250);
  stage.run(5);
  EXPECT_EQ(stage.user(42), 1);
  EXPECT_EQ(stage.carried(kRunner, "Clip"), 0);
  EXPECT_EQ(stage.carried(kDefender, "Clip"), 80);
  EXPECT_EQ(stage.user(41), 80);
  // No monsters, ten bullets short: 0.5 x 1 x (1 + 10 / 60), in thousandths.
  EXPECT_EQ(stage.user(48), 583);
  EXPECT_NEAR(stage.returns[kRunner], 0.02 * 30 + 0.583, 1e-3);
  EXPECT_EQ(stage.returns[kDefender], 0);
}

TEST(AmmoCarrier, AmmunitionComesEvery70TicsUpTo25Items) {
  PlayedScenario stage("ammo_carrier");
  spare(stage);
  stage.run(2);
  stage.put(kRunner, -300, 0);
  EXPECT_EQ(stage.user(43), 1);
  stage.run(70);
  EXPECT_EQ(stage.user(43), 2);
  stage.run(28 * 70);
  EXPECT_EQ(stage.of_type("Clip").size() + stage.of_type("ClipBox").size(), 25u);
}

TEST(AmmoCarrier, AKillOfTheDefendersHealsBoth) {
  PlayedScenario stage("ammo_carrier");
  stage.run(2);
  stage.body(kDefender).health = stage.world().state().players[kDefender].health = 150;
  stage.body(kRunner).health = stage.world().state().players[kRunner].health = 195;
  doom::Actor& zombie = add_monster(stage, "CarrierZombie", -200, 0);
  stage.run(4);
  EXPECT_EQ(stage.user(44), 1);
  EXPECT_EQ(stage.user(46), 1) << "the defender sees it";
  stage.hurt(zombie, 30, kDefender);  // it has 20; the whole shot counts
  stage.run(4);
  EXPECT_EQ(stage.body(kDefender).health, 160);
  EXPECT_EQ(stage.body(kRunner).health, 200) << "never more than 200";
  EXPECT_NEAR(stage.returns[kDefender], 1 + 0.001 * 30, 1e-3);
  stage.hurt(add_monster(stage, "CarrierZombie", -200, 120), 100, -1);
  stage.run(4);
  EXPECT_EQ(stage.body(kDefender).health, 160) << "nobody's kill";
}

TEST(AmmoCarrier, AnyDeathEndsTheRun) {
  PlayedScenario stage("ammo_carrier");
  stage.run(10);
  stage.hurt(stage.body(kRunner), 1000, -1);
  EXPECT_LE(stage.run(10), 3);
  ASSERT_TRUE(stage.environment.last_step().terminated);
  EXPECT_EQ(stage.environment.summary().score, stage.environment.summary().length_tics);
  EXPECT_LT(stage.returns[kRunner], -1) << "the true last variables tell of the death";
  EXPECT_EQ(stage.returns[kDefender], 0);
}

TEST(AmmoCarrier, TheVectorHasTenComponents) {
  PlayedScenario stage("ammo_carrier");
  stage.run(8);
  stage.put(kRunner, 960, 100);
  stage.look(kRunner, 90);
  stage.run(1);
  const std::vector<float> vector = stage.measurements();
  ASSERT_EQ(vector.size(), 20u);
  EXPECT_EQ(vector[0], 200);
  EXPECT_EQ(vector[1], 50);
  EXPECT_EQ(vector[2], 1);
  EXPECT_EQ(vector[12], 0);
  EXPECT_EQ(vector[13], 50);
  EXPECT_NEAR(vector[14], 10 / 60.0, 1e-3);
  EXPECT_EQ(vector[15], 1);
  EXPECT_EQ(vector[16], 0);
  EXPECT_EQ(vector[17], 1);
  // It looks north; the hub lies 960 to the west (left) and 100 to the south (behind).
  EXPECT_NEAR(vector[18], -100 / 2048.0, 2e-3);
  EXPECT_NEAR(vector[19], 960 / 2048.0, 2e-3);
}

TEST(AmmoCarrier, MonstersComeAtTheRateOfTheSpecification) {
  // A wave of five spots with odds of one in four brings 1.25 monsters, every 175 tics; before that four
  // spots with odds of one in two. Spots where somebody stands bring none.
  std::size_t total = 0;
  for (uint64_t seed = 0; seed < 6; ++seed) {
    PlayedScenario stage("ammo_carrier", {.episode_seed = seed});
    spare(stage);
    stage.run(2);
    stage.put(kRunner, -100, 0);
    std::set<uint32_t> seen;
    for (int tic = 0; tic < 70 + 20 * 175; ++tic) {
      stage.run(1);
      for (doom::Actor* monster : stage.things(kMonsterId))
        if (seen.insert(monster->id).second) stage.hurt(*monster, 1000, -1);  // makes room
    }
    total += seen.size();
  }
  EXPECT_GT(total, 6u * 20);
  EXPECT_LT(total, 6u * 34);
}

TEST(AmmoCarrierLayout, ThirtySeedsOfEveryDepotCountGiveMaps) {
  for (const char* depots : {"1", "2", "3"})
    for (uint64_t seed = 0; seed < 30; ++seed) {
      const auto layout =
          scenarios::generate_layout("ammo_carrier", {.seed = seed, .parameters = {{"depots", depots}}});
      ASSERT_TRUE(layout) << layout.error().message;
      EXPECT_TRUE(layout->warnings.empty());
    }
}

TEST(AmmoCarrierOracle, LivesForNineTenthsOfTheLimit) {
  EXPECT_GE(oracle_mean("ammo_carrier", 4), 0.9 * 8400);
}

}  // namespace ammo_carrier_test
}  // namespace comrad::sim
