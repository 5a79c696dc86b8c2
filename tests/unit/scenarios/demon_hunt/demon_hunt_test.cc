// What Smart Enemies and Dumb Enemies have in common: hunters, demons, supplies and endings on the default
// map; rewards; the scripted hunters.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "sim_workers/oracle/oracle.h"
#include "tests/unit/scenarios/demon_hunt/demon_hunt.h"

namespace comrad::sim {
namespace demon_hunt_test {

struct HuntRules {
  const char* scenario;
  const char* demon;          ///< its actor type
  int demon_health;           ///< alone
  int cap, decisions_to_cap;  ///< demons at a time, and when they are there, counted from the second one
  double hit_reward;          ///< of the blow that kills, about
  const char* wide_radius;    ///< of a layout with many obstacles
  double ceiling;
};

class DemonHunting : public ::testing::TestWithParam<HuntRules> {
 protected:
  static test::DemonHunt start(uint64_t seed = 1, int agents = 2) {
    return test::DemonHunt(GetParam().scenario, seed, {}, agents);
  }
};

TEST_P(DemonHunting, HuntersStartWithAShortShotgunAndTwentyShells) {
  test::DemonHunt game = start();
  for (int agent = 0; agent < 2; ++agent) {
    const doom::Player& player = game.world().player(agent);
    ASSERT_NE(player.ready_weapon, doom::kNoType);
    EXPECT_EQ(game.world().catalog()[player.ready_weapon].name, "ShortShotgun");
    EXPECT_EQ(game.shells(agent), 20);
    EXPECT_EQ(player.health, 100);
  }
  EXPECT_EQ(game.script_error(), "");
}

TEST_P(DemonHunting, AShotTakesOneShellAndThirtySevenTics) {
  test::DemonHunt game = start();
  game.decide(8);  // the weapon comes up
  game.press(0).attack = true;
  game.decide(9);  // the first shot is 3 tics after the button
  EXPECT_EQ(game.shells(0), 19);
  game.decide(2);
  EXPECT_EQ(game.shells(0), 18);
  game.decide(7);
  EXPECT_EQ(game.shells(0), 18);
  game.decide(2);
  EXPECT_EQ(game.shells(0), 17);
  EXPECT_EQ(game.shells(1), 20);
}

TEST_P(DemonHunting, DemonsComeEveryThreeSecondsUpToTheCap) {
  test::DemonHunt game = start();
  EXPECT_EQ(game.user(test::kSpawnsVariable), 1);
  game.decide(25);  // 104 tics
  EXPECT_EQ(game.user(test::kSpawnsVariable), 1);
  game.decide(2);
  EXPECT_EQ(game.user(test::kSpawnsVariable), 2);
  game.decide(GetParam().decisions_to_cap);
  EXPECT_EQ(game.user(test::kSpawnsVariable), GetParam().cap);
  EXPECT_EQ(game.user(test::kLivingVariable), GetParam().cap);
}

TEST_P(DemonHunting, DemonsFleeAndNeverBite) {
  test::DemonHunt game = start(3);
  const int health = game.world().player(0).health;
  game.put(1, 700, 0);
  doom::Actor& demon = *game.demon();
  double nearest = 1e9;
  for (int i = 0; i < 60; ++i) {
    game.decide();
    nearest =
        std::min(nearest, std::abs(doom::to_double(demon.x) - doom::to_double(game.world().body(0).x)) +
                              std::abs(doom::to_double(demon.y) - doom::to_double(game.world().body(0).y)));
  }
  EXPECT_GE(game.world().player(0).health, health - 2 * 8) << "the floor alone";
  EXPECT_GT(nearest, 40);
}

TEST_P(DemonHunting, TheFloorTakesTwoEvery32Tics) {
  test::DemonHunt game = start();
  game.decide(80);  // clock 324: ten hits
  EXPECT_EQ(game.world().player(0).health, 80);
  EXPECT_EQ(game.world().player(1).health, 80);
}

TEST_P(DemonHunting, AKillHealsAndRearmsEverybodyAndFreesItsSlot) {
  test::DemonHunt game = start();
  game.hurt(*game.demon(), GetParam().demon_health, 0);
  EXPECT_EQ(game.world().state().kill_total, 1);
  game.decide(2);
  EXPECT_EQ(game.demon(), nullptr) << "the corpse has lost its slot";
  EXPECT_EQ(game.count(GetParam().demon), 1);
  EXPECT_EQ(game.shells(1), 20);
  const int health = game.world().player(1).health;
  game.decide(7);
  EXPECT_EQ(game.shells(0), 25);
  EXPECT_EQ(game.shells(1), 25);
  EXPECT_EQ(game.world().player(1).health, health - 2 + 7) << "one hit of the floor, and the supply";
  game.decide(17);
  EXPECT_EQ(game.user(test::kSpawnsVariable), 2);
  ASSERT_NE(game.demon(), nullptr) << "slot 0 is used again";
  EXPECT_EQ(game.demon()->health, GetParam().demon_health);
  EXPECT_EQ(game.count(GetParam().demon), 1) << "the corpse is gone, 28 and 70 tics after the death";
}

TEST_P(DemonHunting, AKillIsPaidToEverybodyAndTheScoreIsTheTeams) {
  test::DemonHunt game = start();
  game.hurt(*game.demon(), GetParam().demon_health, 0);
  game.decide();
  EXPECT_NEAR(game.reward(0), 5.0 + GetParam().hit_reward, 0.3) << "kill and hit";
  EXPECT_NEAR(game.reward(1), 5.0, 0.1) << "the kill alone";
  game.hurt(*game.world().body_of(1), 1000);
  game.decide(2);
  ASSERT_TRUE(game.over());
  EXPECT_TRUE(game.env.last_step().terminated);
  EXPECT_FLOAT_EQ(game.env.summary().agent_score[0], 1.0f);
  EXPECT_FLOAT_EQ(game.env.summary().score, 1.0f);
  EXPECT_LT(game.reward(1), -10.0f) << "the death is in the last reward";
}

TEST_P(DemonHunting, WithoutKillsThePoisonEndsItAfter1600Tics) {
  test::DemonHunt game = start();
  for (int agent = 0; agent < 2; ++agent) game.put(agent, 16 * agent, 0);
  game.decide(450);
  ASSERT_TRUE(game.over());
  EXPECT_NEAR(game.env.summary().length_tics, 1602, 1);
  EXPECT_FLOAT_EQ(game.env.summary().score, 0.0f);
}

TEST_P(DemonHunting, EveryTeamSizeCounts) {
  for (const int agents : {3, 4}) {
    test::DemonHunt game = start(1, agents);
    for (int agent = 0; agent < agents; ++agent) EXPECT_EQ(game.shells(agent), 20);
    game.decide(50);
    EXPECT_EQ(game.script_error(), "");
  }
}

TEST_P(DemonHunting, ThirtyLayoutsPassValidation) {
  EXPECT_LE(test::refusals_of_layouts(GetParam().scenario, 30), 3);
  EXPECT_LE(test::refusals_of_layouts(GetParam().scenario, 10,
                                      {{"radius", GetParam().wide_radius}, {"obstacles", "42"}}),
            3);
}

TEST_P(DemonHunting, TheScriptedHuntersReachAQuarterOfTheCeiling) {
  for (uint64_t seed : {1'000'000, 1'000'001}) {
    const auto summary = play_oracle_episode(test::generated_game(GetParam().scenario, seed), seed);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_GE(summary->score, 0.25 * GetParam().ceiling) << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Scenarios, DemonHunting,
    ::testing::Values(HuntRules{"smart_enemies", "HuntedDemon", 100, 4, 105, 0.3, "700", 172},
                      HuntRules{"dumb_enemies", "SkittishDemon", 500, 10, 260, 0.3, "850", 172}),
    [](const auto& one) { return std::string(one.param.scenario); });

}  // namespace demon_hunt_test
}  // namespace comrad::sim
