// Dumb Enemies: demons, armour, supplies and endings on the default map; rewards; the scripted hunters.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "sim_workers/oracle/oracle.h"
#include "tests/support/scenario_stage.h"

namespace comrad::sim {
namespace {

constexpr const char* kScenario = "dumb_enemies";
constexpr int kLiving = 31, kSlowNow = 32, kSlowEvents = 33, kSpawns = 34;

struct Game : test::ScenarioGame {
  explicit Game(uint64_t seed = 1, const test::Parameters& parameters = {}, int agents = 2)
      : ScenarioGame(kScenario, seed, parameters, agents) {
    decide();
  }
  doom::Actor* demon(int slot = 0) { return world().find_thing(10000 + slot); }
  int shells(int agent) { return doom::count_item(world(), agent, *world().catalog().find("Shell")); }
  /// The demon of slot 0 held at a place, with the agents so far from it (along y = 0; nobody collides).
  void arrange(int first_distance, int second_distance) {
    doom::Actor& actor = *demon();
    for (int agent = 0; agent < 2; ++agent) world().body_of(agent)->set(doom::ActorFlag::kNoClip);
    actor.set(doom::ActorFlag::kNoClip);
    for (int i = 0; i < 3; ++i) {  // it walks on between the script's looks
      world().set_position(actor.id, 0, 0, actor.z);
      put(0, first_distance, 0), put(1, 0, second_distance);
      decide();
    }
  }
  void hurt(doom::Actor& actor, int amount, int by = -1) {
    doom::Actor* source = by < 0 ? nullptr : world().body_of(by);
    doom::damage_actor(world(), actor, source, source, amount);
  }
};

TEST(DumbEnemies, HuntersStartWithAShortShotgunAndTwentyShells) {
  Game game;
  for (int agent = 0; agent < 2; ++agent) {
    const doom::Player& player = game.world().player(agent);
    ASSERT_NE(player.ready_weapon, doom::kNoType);
    EXPECT_EQ(game.world().catalog()[player.ready_weapon].name, "ShortShotgun");
    EXPECT_EQ(game.shells(agent), 20);
    EXPECT_EQ(player.health, 100);
  }
  EXPECT_EQ(game.script_error(), "");
}

TEST(DumbEnemies, AShotTakesOneShellAndThirtySevenTics) {
  Game game;
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

TEST(DumbEnemies, DemonsComeEveryThreeSecondsUpToTheCap) {
  Game game;
  EXPECT_EQ(game.user(kSpawns), 1);
  game.decide(25);  // 104 tics
  EXPECT_EQ(game.user(kSpawns), 1);
  game.decide(2);
  EXPECT_EQ(game.user(kSpawns), 2);
  game.decide(260);
  EXPECT_EQ(game.user(kSpawns), 10);
  EXPECT_EQ(game.user(kLiving), 10);
}

TEST(DumbEnemies, DemonsFleeAndNeverBite) {
  Game game(3);
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

TEST(DumbEnemies, TheFloorTakesTwoEvery32Tics) {
  Game game;
  game.decide(80);  // clock 324: ten hits
  EXPECT_EQ(game.world().player(0).health, 80);
  EXPECT_EQ(game.world().player(1).health, 80);
}

TEST(DumbEnemies, TwoHuntersNearMakeADemonSlowAndFrail) {
  Game game;
  game.arrange(500, 520);  // 512 is the distance
  EXPECT_EQ(game.user(kSlowNow), 0);
  EXPECT_EQ(game.demon()->health, 500);
  EXPECT_EQ(game.demon()->speed, doom::to_fixed(70));
  game.arrange(500, 500);
  EXPECT_EQ(game.user(kSlowNow), 1);
  EXPECT_EQ(game.user(kSlowEvents), 1);
  EXPECT_EQ(game.demon()->health, 100);
  EXPECT_EQ(game.demon()->speed, doom::to_fixed(21));
}

TEST(DumbEnemies, BeingSlowNeverCreatesHealth) {
  Game game;
  game.arrange(400, 700);
  game.hurt(*game.demon(), 200);
  ASSERT_EQ(game.demon()->health, 300);
  game.arrange(400, 400);
  EXPECT_EQ(game.demon()->health, 100);
  game.hurt(*game.demon(), 40);
  game.arrange(400, 700);
  EXPECT_EQ(game.demon()->health, 260) << "as much armour as was taken from it";
  game.hurt(*game.demon(), 200);
  ASSERT_EQ(game.demon()->health, 60);
  game.arrange(400, 400);
  EXPECT_EQ(game.demon()->health, 60);
  game.arrange(400, 700);
  EXPECT_EQ(game.demon()->health, 60);
}

TEST(DumbEnemies, AKillHealsAndRearmsEverybodyAndFreesItsSlot) {
  Game game;
  game.hurt(*game.demon(), 500, 0);
  EXPECT_EQ(game.world().player(0).kill_count, 1);
  game.decide(2);
  EXPECT_EQ(game.demon(), nullptr) << "the corpse has lost its slot";
  EXPECT_EQ(game.count("SkittishDemon"), 1);
  EXPECT_EQ(game.shells(1), 20);
  const int health = game.world().player(1).health;
  game.decide(7);
  EXPECT_EQ(game.shells(0), 25);
  EXPECT_EQ(game.shells(1), 25);
  EXPECT_EQ(game.world().player(1).health, health - 2 + 7) << "one hit of the floor, and the supply";
  game.decide(17);
  EXPECT_EQ(game.user(kSpawns), 2);
  ASSERT_NE(game.demon(), nullptr) << "slot 0 is used again";
  EXPECT_EQ(game.demon()->health, 500);
  EXPECT_EQ(game.count("SkittishDemon"), 1) << "the corpse is gone, 28 and 70 tics after the death";
}

TEST(DumbEnemies, TheKillerIsPaidAndTheScoreIsTheMeanOfOwnKills) {
  Game game;
  game.hurt(*game.demon(), 500, 0);
  game.decide();
  EXPECT_NEAR(game.reward(0), 5.0 + 0.1, 0.3) << "kill and hit";
  EXPECT_LT(game.reward(1), 0.1f);
  game.hurt(*game.world().body_of(1), 1000);
  game.decide(2);
  ASSERT_TRUE(game.over());
  EXPECT_TRUE(game.env.last_step().terminated);
  EXPECT_FLOAT_EQ(game.env.summary().agent_score[0], 1.0f);
  EXPECT_FLOAT_EQ(game.env.summary().score, 0.5f);
  EXPECT_LT(game.reward(1), -10.0f) << "the death is in the last reward";
}

TEST(DumbEnemies, WithoutKillsThePoisonEndsItAfter1600Tics) {
  Game game;
  for (int agent = 0; agent < 2; ++agent) game.put(agent, 16 * agent, 0);
  game.decide(450);
  ASSERT_TRUE(game.over());
  EXPECT_NEAR(game.env.summary().length_tics, 1602, 1);
  EXPECT_FLOAT_EQ(game.env.summary().score, 0.0f);
}

TEST(DumbEnemies, EveryTeamSizeCounts) {
  for (const int agents : {3, 4}) {
    Game game(1, {}, agents);
    for (int agent = 0; agent < agents; ++agent) EXPECT_EQ(game.shells(agent), 20);
    game.decide(50);
    EXPECT_EQ(game.script_error(), "");
  }
}

TEST(DumbEnemies, ThirtyLayoutsPassValidation) {
  EXPECT_LE(test::refusals_of_layouts(kScenario, 30), 3);
  EXPECT_LE(test::refusals_of_layouts(kScenario, 10, {{"radius", "850"}, {"obstacles", "42"}}), 3);
}

TEST(DumbEnemies, TheScriptedHuntersReachAQuarterOfTheCeiling) {
  for (uint64_t seed : {1'000'000, 1'000'001}) {
    const auto summary = play_oracle_episode(test::generated_game(kScenario, seed), seed);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_GE(summary->score, 0.25 * 90) << seed;
  }
}

}  // namespace
}  // namespace comrad::sim
