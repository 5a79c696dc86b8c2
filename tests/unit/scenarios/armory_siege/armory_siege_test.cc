// Armory Siege: the timetable of doors and items, waves, the core, rewards and endings; layouts; the scripted team.
#include <cmath>

#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace armory_siege_test {

constexpr int32_t kCoreId = 50, kEnemyId = 60;

doom::Actor& core(PlayedScenario& stage) { return *stage.things(kCoreId).at(0); }
double door_opening(PlayedScenario& stage, int door) {
  for (const doom::Sector& sector : stage.world().sectors())
    if (sector.tag == 10 + door) return doom::to_double(sector.ceiling_height - sector.floor_height);
  return -1;
}
void spare(PlayedScenario& stage) {
  for (std::size_t agent = 0; agent < stage.buttons.size(); ++agent)
    stage.body(static_cast<int>(agent)).set(doom::ActorFlag::kInvulnerable);
}

TEST(ArmorySiege, AgentsBeginUnarmedInTheHallWhateverTheTeam) {
  for (const int agents : {2, 8}) {
    PlayedScenario stage("armory_siege", {.num_agents = agents});
    stage.run(2);
    for (int agent = 0; agent < agents; ++agent) {
      EXPECT_EQ(stage.world().player(agent).ready_weapon, doom::kNoType);
      EXPECT_EQ(stage.carried(agent, "Fist") + stage.carried(agent, "Pistol") + stage.carried(agent, "Clip"),
                0);
      EXPECT_LT(std::abs(place_of(stage.body(agent)).x), 256);
      EXPECT_LT(std::abs(place_of(stage.body(agent)).y), 256);
    }
    EXPECT_EQ(stage.user(1), 1000);
    EXPECT_EQ(core(stage).x >> 16, stage.user(2));
    EXPECT_EQ(stage.of_type("SiegePistol").size(), 3u);
    EXPECT_EQ(stage.of_type("Clip").size(), 3u);
  }
}

TEST(ArmorySiege, DoorsFollowTheTimetable) {
  PlayedScenario stage("armory_siege");
  spare(stage);
  const bool open_at[3][12] = {
      {true, true, true, false, false, true, true, true, false, false, true, true},
      {false, false, true, true, true, false, false, true, true, true, false, false},
      {false, false, false, false, true, true, true, false, false, true, true, true}};
  stage.run(1);
  for (int hundred = 0; hundred < 24; ++hundred) {
    stage.run(90);
    core(stage).health = 1000;
    // A has a third opening that continues into the next cycle: from the second cycle on it is open at 1200
    // as well.
    for (int door = 0; door < 3; ++door)
      EXPECT_EQ(door_opening(stage, door) > 56, open_at[door][hundred % 12])
          << "door " << door << " at " << hundred * 100 + 90;
    stage.run(10);
  }
}

TEST(ArmorySiege, EachOpeningBringsTheRoomsItem) {
  PlayedScenario stage("armory_siege");
  spare(stage);
  stage.run(2);
  EXPECT_EQ(stage.of_type("SiegeShotgun").size(), 1u);
  EXPECT_TRUE(stage.of_type("ShellBox").empty());
  stage.run(200);
  EXPECT_EQ(stage.of_type("ShellBox").size(), 1u);
  stage.run(200);
  EXPECT_EQ(stage.of_type("Medikit").size(), 1u);
  stage.run(150);
  EXPECT_EQ(stage.of_type("SiegeShotgun").size(), 1u) << "it still lies there";
}

TEST(ArmorySiege, AgentsCannotHurtTheCoreAndMonstersCan) {
  PlayedScenario stage("armory_siege");
  stage.run(2);
  stage.give(0, "SiegePistol", 1);
  stage.run(40);
  stage.world().state().rng = Rng(uint64_t{1});
  const Place at = place_of(core(stage));
  const double side = at.x > 0 ? -80 : 80;
  stage.put(0, at.x + side, at.y);
  stage.look(0, side > 0 ? 180 : 0);
  stage.buttons[0].attack = true;
  stage.run(40);
  EXPECT_LT(stage.carried(0, "Clip"), 20) << "it did shoot";
  EXPECT_EQ(core(stage).health, 1000);
  EXPECT_EQ(stage.variable(0, "HITCOUNT"), 0);
  const double before = stage.returns[1];
  stage.hurt(core(stage), 50, -1);
  stage.run(2);
  EXPECT_EQ(stage.user(1), 950);
  EXPECT_NEAR(stage.returns[1] - before, -0.5, 1e-4);
}

TEST(ArmorySiege, SuppliesPayOnceAndNothingIsPaidForComingBack) {
  PlayedScenario stage("armory_siege");
  stage.run(2);
  stage.give(0, "SiegePistol", 1);
  stage.run(2);
  EXPECT_EQ(stage.user(6), 20);
  EXPECT_NEAR(stage.returns[0], 1 + 20 * 0.012, 1e-3);
  stage.give(0, "SiegeShotgun", 1);
  stage.run(2);
  EXPECT_EQ(stage.user(14), 8);
  EXPECT_NEAR(stage.returns[0], 1.3 + 28 * 0.012, 1e-3);
  EXPECT_EQ(stage.variable(0, "WEAPON1"), 1);
  EXPECT_EQ(stage.variable(0, "WEAPON2"), 1);
  const double before = stage.returns[0];
  stage.hurt(stage.body(0), 1000, -1);
  stage.run(60);
  ASSERT_TRUE(stage.world().player(0).alive);
  EXPECT_EQ(stage.carried(0, "SiegePistol") + stage.carried(0, "SiegeShotgun") + stage.carried(0, "Fist"), 0);
  EXPECT_EQ(stage.user(6), 0);
  EXPECT_NEAR(stage.returns[0] - before, -2, 1e-3);
}

TEST(ArmorySiege, ArmedWithoutARoundCosts) {
  PlayedScenario stage("armory_siege", {.frame_skip = 4});
  stage.run(1);
  stage.give(0, "SiegePistol", 1);
  doom::take_item(stage.world(), 0, *stage.world().catalog().find("Clip"), 1000);
  stage.run(1);
  const double before = stage.returns[0];
  stage.run(5);
  EXPECT_NEAR(stage.returns[0] - before, -0.02 * 5, 1e-4);
}

TEST(ArmorySiege, WavesHaveTheirIntervalsHealthAndGoForTheCore) {
  PlayedScenario stage("armory_siege");
  spare(stage);
  stage.run(198);
  EXPECT_TRUE(stage.things(kEnemyId).empty());
  stage.run(5);
  ASSERT_EQ(stage.things(kEnemyId).size(), 1u);
  EXPECT_EQ(stage.things(kEnemyId)[0]->health, 10) << "half of a zombie's 20";
  EXPECT_EQ(stage.world().actor(stage.things(kEnemyId)[0]->target_id)->thing_id, kCoreId);
  stage.run(600);
  EXPECT_LT(stage.user(1), 1000) << "the first one is at the core";
}

TEST(ArmorySiege, TheCoresDeathEndsTheRunAtOnceAndCosts) {
  PlayedScenario stage("armory_siege");
  stage.run(20);
  const double before = stage.returns[0];
  stage.hurt(core(stage), 5000, -1);
  EXPECT_LE(stage.run(10), 4);
  ASSERT_TRUE(stage.environment.last_step().terminated);
  EXPECT_NEAR(stage.returns[0] - before, -7 - 0.01 * 1000, 1e-3);
  EXPECT_NEAR(stage.environment.summary().agent_score[0], stage.returns[0], 1e-3) << "J is the own return";
}

TEST(ArmorySiege, TheVectorHasNineComponents) {
  PlayedScenario stage("armory_siege");
  stage.run(2);
  stage.give(0, "SiegePistol", 1);
  stage.run(60);
  stage.hurt(core(stage), 100, -1);
  stage.run(2);
  const std::vector<float> vector = stage.measurements();
  ASSERT_EQ(vector.size(), 18u);
  const float expected[] = {100, 20, 0, 1, 0, 0.9f, 1, 0, 1};
  for (int i = 0; i < 9; ++i) EXPECT_NEAR(vector[i], expected[i], 1e-3) << "component " << i;
}

TEST(ArmorySiegeLayout, ThirtySeedsOfEveryDistanceGiveMaps) {
  for (const char* distance : {"500", "600", "700", "900"})
    for (uint64_t seed = 0; seed < 30; ++seed) {
      const auto layout =
          scenarios::generate_layout("armory_siege", {.seed = seed, .parameters = {{"distance", distance}}});
      ASSERT_TRUE(layout) << layout.error().message;
      EXPECT_TRUE(layout->warnings.empty());
    }
}

TEST(ArmorySiegeLayout, TheCoreFindsASpotAmongEightAgents) {
  // The first map that this seed draws has all five spots at starts, where the core cannot be put down.
  PlayedScenario stage("armory_siege", {.num_agents = 8, .layout_seed = 7, .parameters = kVaried});
  stage.run(4);
  EXPECT_FALSE(stage.over());
  EXPECT_EQ(stage.user(1), 1000);
}

TEST(ArmorySiegeOracle, GunsGoToThoseWhoHaveNone) {
  const auto game = make_game("armory_siege", {.num_agents = 4, .frame_skip = 4});
  ASSERT_NE(game, nullptr);
  auto player = OraclePlayer::create(*game);
  ASSERT_TRUE(player) << player.error().message;
  DoomEnvironment environment(game);
  player->reset(environment, 1);
  const uint32_t shotgun = *environment.world().catalog().find("SiegeShotgun");
  for (int i = 0; i < 700 && !environment.last_step().episode_over(); ++i) player->step(environment);
  for (int agent = 0; agent < 4; ++agent)
    EXPECT_EQ(doom::count_item(environment.world(), agent, shotgun), 1) << "agent " << agent;
}

TEST(ArmorySiegeOracle, EarnsMoreThanThePublishedCeiling) { EXPECT_GE(oracle_mean("armory_siege", 4), 100); }

TEST(ArmorySiegeOracle, EarnsItOnVariedMapsToo) { EXPECT_GE(oracle_mean("armory_siege", 4, kVaried), 50); }

}  // namespace armory_siege_test
}  // namespace comrad::sim
