// Stealth Labyrinth: the map's numbers, the script's rules on the default map, rewards, endings, the
// scripted team.
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "scenarios/stealth_labyrinth/layout.h"
#include "sim_workers/oracle/oracle.h"
#include "tests/support/scenario_stage.h"

namespace comrad::sim {
namespace stealth_labyrinth_test {

constexpr const char* kScenario = "stealth_labyrinth";
constexpr int kTorchAlive = 41, kGunnerAlive = 42, kTeamDistance = 43, kTurretsLeft = 44, kTargetLit = 45,
              kDestroyed = 46, kTotal = 47, kRoomsSeen = 48, kRooms = 49, kTeamHealth = 50, kMilestones = 51;
constexpr int kTorch = 0, kGunner = 1;

struct Game : test::ScenarioGame {
  explicit Game(const test::Parameters& parameters = {}) : ScenarioGame(kScenario, 1, parameters) {
    decide(4);
  }
  int light(int tag) {
    for (const doom::Sector& sector : world().sectors())
      if (sector.tag == tag) return sector.light;
    return -1;
  }
  doom::Actor* turret(int number) { return world().find_thing(6000 + number); }
  void hurt(doom::Actor& actor, int amount) { doom::damage_actor(world(), actor, nullptr, nullptr, amount); }
  bool can_be_hurt(int number) { return !turret(number)->has(doom::ActorFlag::kInvulnerable); }
};

TEST(StealthLabyrinth, TheDefaultMapHasTheSpecifiedRooms) {
  scenarios::LayoutDraw draw;
  for (const auto& parameter : scenarios::stealth_labyrinth::recipe().parameters)
    draw.values[parameter.name] = parameter.default_value;
  const auto plan = scenarios::stealth_labyrinth::plan(draw);
  ASSERT_EQ(plan.rooms.size(), 2u);
  EXPECT_EQ(plan.rooms[0].centre, (doomgen::Point{0, 980}));
  EXPECT_EQ(plan.rooms[1].centre, (doomgen::Point{0, 980 + 1024}));
  EXPECT_EQ(plan.rooms[0].box.high.x - plan.rooms[0].box.low.x, 416);
  EXPECT_EQ(plan.rooms[0].box.high.y - plan.rooms[0].box.low.y, 896);
  ASSERT_EQ(plan.rooms[0].turrets.size(), 1u);
  EXPECT_EQ(plan.rooms[0].turrets[0], (doomgen::Point{0, 1108}));
  EXPECT_EQ(plan.rooms[1].turrets[0], (doomgen::Point{0, 2308}));
  EXPECT_EQ(plan.rooms[0].turret_health, 90);
  EXPECT_EQ(plan.rooms[1].turret_health, 140);
}

TEST(StealthLabyrinth, BranchesGoNorthWestAndEast) {
  scenarios::LayoutDraw draw;
  for (const auto& parameter : scenarios::stealth_labyrinth::recipe().parameters)
    draw.values[parameter.name] = parameter.default_value;
  draw.values["branches"] = 3, draw.values["turrets_low"] = draw.values["turrets_high"] = 2;
  const auto plan = scenarios::stealth_labyrinth::plan(draw);
  ASSERT_EQ(plan.rooms.size(), 6u);
  EXPECT_EQ(plan.rooms[2].centre, (doomgen::Point{-980, 0}));
  EXPECT_EQ(plan.rooms[4].centre, (doomgen::Point{980, 0}));
  // The second turret stands a quarter of the width to the left of the way in.
  EXPECT_EQ(plan.rooms[0].turrets[1], (doomgen::Point{-104, 1012}));
  EXPECT_EQ(plan.rooms[2].turrets[1], (doomgen::Point{-1012, -104}));
  EXPECT_EQ(plan.rooms[4].turrets[1], (doomgen::Point{1012, 104}));
}

TEST(StealthLabyrinth, ThirtyLayoutsPassValidationAtEveryEndOfTheAxes) {
  EXPECT_LE(test::refusals_of_layouts(kScenario, 30), 3);
  for (const char* rooms : {"1", "3"})
    for (const char* branches : {"1", "3"})
      test::refusals_of_layouts(kScenario, 5,
                                {{"rooms", rooms},
                                 {"branches", branches},
                                 {"turrets_high", "2"},
                                 {"room_width", "384"},
                                 {"room_length", "768"},
                                 {"corridor", "5"}});
}

TEST(StealthLabyrinth, RolesHaveTheirGear) {
  Game game;
  EXPECT_EQ(game.world().player(kTorch).ready_weapon, doom::kNoType);
  const doom::Player& gunner = game.world().player(kGunner);
  ASSERT_NE(gunner.ready_weapon, doom::kNoType);
  EXPECT_EQ(game.world().catalog()[gunner.ready_weapon].name, "Chaingun");
  EXPECT_EQ(doom::count_item(game.world(), kGunner, *game.world().catalog().find("Clip")), 240);
  EXPECT_EQ(doom::count_item(game.world(), kTorch, *game.world().catalog().find("Clip")), 0);
  EXPECT_EQ(game.user(kTorchAlive), 1);
  EXPECT_EQ(game.user(kGunnerAlive), 1);
  EXPECT_EQ(game.user(kTeamDistance), 80);
  EXPECT_EQ(game.user(kTeamHealth), 200);
  EXPECT_EQ(game.user(kTurretsLeft), 2);
  EXPECT_EQ(game.user(kTotal), 2);
  EXPECT_EQ(game.user(kRooms), 2);
  EXPECT_EQ(game.script_error(), "");
}

TEST(StealthLabyrinth, OnlyTheTorchCarriesLight) {
  Game game;
  EXPECT_EQ(game.light(100), 224) << "the start room, where the torch is";
  for (const int tag : {101, 102, 103, 200, 201, 202}) EXPECT_EQ(game.light(tag), 0) << tag;
  game.put(kGunner, 0, 980);
  game.decide();
  EXPECT_EQ(game.light(102), 0) << "the gunner lights nothing";
  game.put(kTorch, 60, 0);
  game.decide();
  EXPECT_EQ(game.light(101), 160);
  EXPECT_EQ(game.light(100), 0);
  game.put(kTorch, 0, 380);
  game.decide();
  EXPECT_EQ(game.light(201), 176) << "the approach corridor";
  game.put(kTorch, 0, 800);
  game.decide();
  EXPECT_EQ(game.light(102), 224);
  EXPECT_EQ(game.light(101), 0);
}

TEST(StealthLabyrinth, TheRoomBehindStaysEmptyUntilTheFirstIsCleared) {
  Game game;
  ASSERT_NE(game.turret(0), nullptr);
  EXPECT_EQ(game.turret(0)->health, 90);
  EXPECT_EQ(game.turret(1), nullptr);
  game.put(kTorch, 0, 800), game.put(kGunner, 0, 700);
  game.decide();
  game.hurt(*game.turret(0), 90);
  game.decide();
  EXPECT_EQ(game.user(kDestroyed), 1);
  EXPECT_EQ(game.user(kTurretsLeft), 1);
  ASSERT_NE(game.turret(1), nullptr);
  EXPECT_EQ(game.turret(1)->health, 140);
}

TEST(StealthLabyrinth, ATurretCanBeHurtOnlyWhileItsRoomIsLit) {
  Game game;
  EXPECT_FALSE(game.can_be_hurt(0));
  game.hurt(*game.turret(0), 50);
  EXPECT_EQ(game.turret(0)->health, 90);
  game.put(kTorch, 0, 480);  // in the approach corridor
  game.decide();
  EXPECT_EQ(game.user(kTargetLit), 1);
  EXPECT_TRUE(game.can_be_hurt(0));
  EXPECT_EQ(game.user(kMilestones), 1);
  EXPECT_EQ(game.user(kRoomsSeen), 1) << "within 64 units of the room counts as in it";
  game.put(kTorch, 60, 0);
  game.decide();
  EXPECT_EQ(game.user(kTargetLit), 0);
  EXPECT_FALSE(game.can_be_hurt(0));
}

TEST(StealthLabyrinth, TheTurretHuntsTheAgentNearerToTheMiddleOfItsRoom) {
  Game game;
  game.put(kTorch, 0, 600), game.put(kGunner, 100, 560);
  game.decide();
  EXPECT_EQ(game.turret(0)->target_id, game.world().body(kTorch).id);
  game.put(kGunner, 100, 900);
  game.decide();
  EXPECT_EQ(game.turret(0)->target_id, game.world().body(kGunner).id);
}

TEST(StealthLabyrinth, TurretsFireBurstsOfTwoBolts) {
  Game game;
  game.put(kTorch, 0, 600), game.put(kGunner, 40, 560);
  int most = 0;
  for (int i = 0; i < 30 && !game.over(); ++i) {
    game.decide();
    most = std::max(most, game.count("StealthBolt"));
  }
  EXPECT_GE(most, 2);
  EXPECT_LT(game.user(kTeamHealth), 200) << "who stands still is hit";
}

TEST(StealthLabyrinth, ClearingAllTurretsEndsTheMapWithTheScoreOfOne) {
  Game game;
  game.put(kTorch, 0, 800), game.put(kGunner, 0, 700);
  game.decide();
  // 0.4 lit, 0.8 for the first room; halves for each of the two.
  game.hurt(*game.turret(0), 90);
  game.decide();
  EXPECT_FLOAT_EQ(game.reward(kTorch), 1.0f) << "a turret is worth 2 / N";
  game.put(kTorch, 0, 1800), game.put(kGunner, 0, 1700);
  game.decide();
  EXPECT_NEAR(game.reward(kGunner), (0.4 + 0.3) / 2, 0.1);
  game.hurt(*game.turret(1), 140);
  game.decide(2);
  ASSERT_TRUE(game.over());
  EXPECT_TRUE(game.env.last_step().terminated);
  EXPECT_FLOAT_EQ(game.env.summary().score, 1.0f);
  EXPECT_GT(game.reward(kTorch), 0.0f) << "no penalty for success: the variables are those of the last tic";
}

TEST(StealthLabyrinth, ADeathEndsTheMapAndCostsTheTeam) {
  Game game;
  game.hurt(*game.world().body_of(kGunner), 1000);
  game.decide(2);
  ASSERT_TRUE(game.over());
  EXPECT_TRUE(game.env.last_step().terminated);
  EXPECT_FLOAT_EQ(game.env.summary().score, 0.0f);
  EXPECT_FLOAT_EQ(game.reward(kTorch), -0.5f * (1.0f + 0.02f * 100))
      << "100 points of health and the failure";
}

TEST(StealthLabyrinth, TheLimitTruncates) {
  Game game;
  game.decide(5250);
  ASSERT_TRUE(game.over());
  EXPECT_TRUE(game.env.last_step().truncated || game.user(kTeamHealth) < 200);
  EXPECT_NE(game.env.last_step().truncated, game.env.last_step().terminated);
}

TEST(StealthLabyrinth, TheScriptedTeamClearsEveryMap) {
  for (uint64_t seed : {1'000'000, 1'000'001, 1'000'002}) {
    const auto summary = play_oracle_episode(test::generated_game(kScenario, seed), seed);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_FLOAT_EQ(summary->score, 1.0f) << seed;
  }
}

}  // namespace stealth_labyrinth_test
}  // namespace comrad::sim
