// The attacks of Doom's monsters, by what they do to a player who stands still.
#include <gtest/gtest.h>
#include <algorithm>

#include <cmath>
#include <set>

#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/sight.h"
#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace monster_actions_test {

using test::LevelBuilder;
using test::Stage;

/// Runs one action of a monster that has the player as its target.
void act(Stage& stage, Actor& actor, ActionId id) {
  State state;
  state.action = id;
  ActionCall call{.world = stage.world, .self = actor, .state = state, .args = {}};
  run_action(call);
}

// ---------------------------------------------------------------- everybody fights

class EveryMonster : public ::testing::TestWithParam<const char*> {};

TEST_P(EveryMonster, HurtsAPlayerItSees) {
  Stage stage;
  stage.make_player_tough();
  const uint32_t id = stage.spawn(GetParam(), 300, 0, 180).id;
  EXPECT_TRUE(stage.tics_until(35 * 40, [&] { return stage.player().damage_taken > 0; }));
  EXPECT_NE(stage.world.actor(id), nullptr);
}

TEST_P(EveryMonster, DiesAndLiesStill) {
  Stage stage;
  Actor& monster = stage.spawn(GetParam(), 300, 0, 180);
  const uint32_t id = monster.id;
  damage_actor(stage.world, monster, &stage.body(), &stage.body(), monster.health);
  stage.tics(35 * 10);
  const Actor* corpse = stage.world.actor(id);
  if (corpse == nullptr) return;  // lost souls and pain elementals burst
  EXPECT_LE(corpse->health, 0);
  EXPECT_FALSE(corpse->has(ActorFlag::kSolid));
  EXPECT_FALSE(corpse->has(ActorFlag::kShootable));
  EXPECT_EQ(corpse->tics, -1);
}

INSTANTIATE_TEST_SUITE_P(OfDoom, EveryMonster,
                         ::testing::Values("ZombieMan", "ShotgunGuy", "ChaingunGuy", "WolfensteinSS",
                                           "DoomImp", "Demon", "Spectre", "LostSoul", "Cacodemon",
                                           "PainElemental", "HellKnight", "BaronOfHell", "Arachnotron",
                                           "Fatso", "Revenant", "Archvile", "Cyberdemon", "SpiderMastermind",
                                           "MarineChainsaw", "MarinePistol", "MarineShotgun", "MarineRocket",
                                           "MarinePlasma"),
                         [](const auto& given) { return std::string(given.param); });

// ---------------------------------------------------------------- numbers

struct Dice {
  const char* monster;
  ActionId action;
  int distance;
  int32_t factor, sides;
};

class Blows : public ::testing::TestWithParam<Dice> {};

TEST_P(Blows, DealWhatDoomDeals) {
  const Dice& dice = GetParam();
  Stage stage;
  stage.make_player_tough();
  Actor& monster = stage.spawn(dice.monster, dice.distance, 0, 180);
  monster.target_id = stage.body().id;
  std::set<int32_t> dealt;
  for (int i = 0; i < 600; ++i) {
    const int32_t before = stage.body().health;
    act(stage, monster, dice.action);
    if (before != stage.body().health) dealt.insert(before - stage.body().health);
  }
  std::set<int32_t> expected;
  for (int32_t roll = 1; roll <= dice.sides; ++roll) expected.insert(roll * dice.factor);
  EXPECT_EQ(dealt, expected);
}

INSTANTIATE_TEST_SUITE_P(OfDoom, Blows,
                         ::testing::Values(Dice{"DoomImp", ActionId::kTroopAttack, 50, 3, 8},
                                           Dice{"Demon", ActionId::kSargAttack, 50, 4, 10},
                                           Dice{"Cacodemon", ActionId::kHeadAttack, 50, 10, 6},
                                           Dice{"BaronOfHell", ActionId::kBruisAttack, 50, 10, 8},
                                           Dice{"Revenant", ActionId::kSkelFist, 50, 6, 10},
                                           Dice{"ZombieMan", ActionId::kPosAttack, 60, 3, 5},
                                           Dice{"ChaingunGuy", ActionId::kCPosAttack, 60, 3, 5},
                                           Dice{"LostSoul", ActionId::kBetaSkullAttack, 50, 3, 8}),
                         [](const auto& given) {
                           return std::string(given.param.monster) + std::to_string(given.index);
                         });

TEST(ShotgunGuy, FiresThreePelletsOfThreeToFifteen) {
  Stage stage;
  stage.make_player_tough();
  Actor& guy = stage.spawn("ShotgunGuy", 60, 0, 180);
  guy.target_id = stage.body().id;
  int64_t sum = 0;
  constexpr int kShots = 2000;
  for (int i = 0; i < kShots; ++i) {
    const int32_t before = stage.body().health;
    act(stage, guy, ActionId::kSPosAttackUseAtkSound);
    const int32_t dealt = before - stage.body().health;
    EXPECT_LE(dealt, 45);
    EXPECT_EQ(dealt % 3, 0);
    sum += dealt;
  }
  EXPECT_NEAR(static_cast<double>(sum) / kShots, 27.0, 1.0);
}

TEST(ZombieMan, MissesFarTargetsAsOftenAsItsSpreadGives) {
  Stage stage;
  stage.make_player_tough();
  Actor& zombie = stage.spawn("ZombieMan", 800, 0, 180);
  zombie.target_id = stage.body().id;
  int hits = 0;
  constexpr int kShots = 3000;
  for (int i = 0; i < kShots; ++i) {
    const int32_t before = stage.body().health;
    act(stage, zombie, ActionId::kPosAttack);
    hits += before != stage.body().health;
  }
  // Spread: the difference of two draws of 0..255, times 1/4096 of a turn. The body covers about +-1.3
  // of 22.5 degrees, a triangle's middle: 11 of 100.
  EXPECT_GT(hits, kShots * 7 / 100);
  EXPECT_LT(hits, kShots * 16 / 100);
}

// ---------------------------------------------------------------- missiles

TEST(Mancubus, ItsThreeVolleysLeaveFanwise) {
  Stage stage;
  Actor& fatso = stage.spawn("Fatso", 500, 0, 180);
  fatso.target_id = stage.body().id;
  const auto expect_angles = [&](ActionId id, double low, double high) {
    const std::size_t first = stage.world.actors().size();
    act(stage, fatso, id);
    std::vector<double> degrees;
    for (std::size_t slot = first; slot < stage.world.actors().size(); ++slot)
      degrees.push_back(stage.world.actors()[slot].angle * (360.0 / 4294967296.0));
    std::sort(degrees.begin(), degrees.end());
    ASSERT_EQ(degrees.size(), 2u);
    EXPECT_NEAR(degrees[0], low, 0.05);
    EXPECT_NEAR(degrees[1], high, 0.05);
  };
  expect_angles(ActionId::kFatAttack1, 180, 191.25);
  expect_angles(ActionId::kFatAttack2, 157.5, 180);
  expect_angles(ActionId::kFatAttack3, 174.375, 185.625);
}

TEST(Revenant, ItsMissileFollowsAPlayerWhoStepsAside) {
  int hits = 0;
  for (uint64_t seed = 0; seed < 8; ++seed) {
    Stage stage(test::big_room().build(), {.seed = seed});
    stage.make_player_tough();
    Actor& revenant = stage.spawn("Revenant", 700, 0, 180);
    revenant.tics = -1;
    revenant.target_id = stage.body().id;
    act(stage, revenant, ActionId::kSkelMissile);
    set_position(stage.world, stage.body().id, 0, to_fixed(300), 0);
    stage.tics(35 * 5);
    hits += stage.player().damage_taken > 0;
  }
  EXPECT_GE(hits, 6);
}

// ---------------------------------------------------------------- arch-vile

TEST(Archvile, RaisesTheDead) {
  Stage stage;
  stage.world.state().players[0].no_target = true;
  Actor& imp = stage.spawn("DoomImp", 500, 0, 180);
  const uint32_t imp_id = imp.id;
  damage_actor(stage.world, imp, nullptr, nullptr, 60);
  stage.tics(70);
  ASSERT_LE(stage.at(imp_id).health, 0);
  Actor& vile = stage.spawn("Archvile", 550, 0, 180);
  vile.target_id = stage.body().id;
  vile.move_direction = kWest;
  vile.move_count = 50;
  act(stage, vile, ActionId::kVileChase);
  EXPECT_EQ(stage.at(imp_id).health, 60);
  EXPECT_FALSE(stage.at(imp_id).is_corpse());
  EXPECT_EQ(stage.at(imp_id).height, to_fixed(56));
  EXPECT_TRUE(stage.is_in(stage.at(vile.id), StateLabel::kHeal, 3));
  EXPECT_TRUE(stage.tics_until(70, [&] {
    return stage.is_in(stage.at(imp_id), StateLabel::kSee) ||
           stage.is_in(stage.at(imp_id), StateLabel::kSpawn, 2);
  }));
}

TEST(Archvile, DoesNotRaiseWhereSomebodyStandsOnTheCorpse) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 500, 0, 180);
  const uint32_t imp_id = imp.id;
  damage_actor(stage.world, imp, nullptr, nullptr, 60);
  stage.tics(70);
  stage.spawn("ExplosiveBarrel", 505, 0);
  Actor& vile = stage.spawn("Archvile", 550, 0, 180);
  vile.target_id = stage.body().id;
  vile.move_direction = kWest;
  vile.move_count = 50;
  act(stage, vile, ActionId::kVileChase);
  EXPECT_LE(stage.at(imp_id).health, 0);
  EXPECT_TRUE(stage.at(imp_id).is_corpse());
}

TEST(Archvile, ItsFireStaysOnTheVictimAndThrowsItUp) {
  Stage stage;
  stage.make_player_tough();
  Actor& vile = stage.spawn("Archvile", 500, 0, 180);
  vile.target_id = stage.body().id;
  act(stage, vile, ActionId::kVileTarget);
  const uint32_t fire = vile.tracer_id;
  ASSERT_NE(stage.world.actor(fire), nullptr);
  EXPECT_EQ(stage.at(fire).x, to_fixed(24));  // in front of the player's eyes
  act(stage, vile, ActionId::kVileAttack);
  EXPECT_EQ(stage.body().velocity_z, to_fixed(10));
  EXPECT_GE(stage.player().damage_taken, 20 + 40);
  EXPECT_LE(stage.player().damage_taken, 20 + 70);
}

// ---------------------------------------------------------------- souls, brain, barrels

TEST(PainElemental, SpitsSoulsAndMoreWhenItDies) {
  Stage stage;
  stage.make_player_tough();
  Actor& pain = stage.spawn("PainElemental", 500, 0, 180);
  pain.target_id = stage.body().id;
  act(stage, pain, ActionId::kPainAttack);
  EXPECT_EQ(stage.count("LostSoul"), 1);
  const Actor& soul = stage.world.actors()[stage.world.actors().size() - 1];
  EXPECT_TRUE(soul.has(ActorFlag::kSkullFly));
  EXPECT_LT(soul.velocity_x, to_fixed(-19));
  pain.x = to_fixed(800);
  act(stage, pain, ActionId::kPainDie);
  EXPECT_EQ(stage.count("LostSoul"), 4);
}

TEST(PainElemental, ASoulThatWouldComeThroughAWallDies) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 440, -200, 448, 200);
  Stage stage(builder.build());
  Actor& pain = stage.spawn("PainElemental", 490, 0, 180);
  pain.target_id = stage.body().id;
  act(stage, pain, ActionId::kPainAttack);
  for (const Actor& actor : stage.world.actors())
    EXPECT_TRUE(stage.world.type_of(actor).name != "LostSoul" || actor.health <= 0);
}

TEST(BossBrain, ItsEyeSendsCubesThatBecomeMonsters) {
  LevelBuilder builder = test::big_room();
  builder.thing(87, -600, -600).thing(87, 600, 600);
  Stage stage(builder.build());
  stage.make_player_tough();
  const uint32_t eye = stage.spawn("BossEye", 500, 0, 180).id;
  set_label(stage.world, stage.at(eye), StateLabel::kSee);
  const auto monsters = [&] {
    int count = 0;
    for (const Actor& actor : stage.world.actors())
      count += actor.has(ActorFlag::kIsMonster) && actor.health > 0;
    return count;
  };
  EXPECT_EQ(monsters(), 0);
  EXPECT_TRUE(stage.tics_until(35 * 30, [&] { return monsters() >= 2; }));
}

TEST(BossBrain, ItsDeathEndsTheLevel) {
  Stage stage;
  Actor& brain = stage.spawn("BossBrain", 500, 0, 180);
  damage_actor(stage.world, brain, &stage.body(), &stage.body(), 1000);
  stage.tics(35 * 10);
  EXPECT_TRUE(stage.world.level_exited());
}

TEST(Barrel, ExplodesAndTakesItsNeighbourAlong) {
  Stage stage;
  Actor& barrel = stage.spawn("ExplosiveBarrel", 300, 0);
  const uint32_t neighbour = stage.spawn("ExplosiveBarrel", 360, 0).id;
  const uint32_t imp = stage.spawn("DoomImp", 440, 0).id;
  damage_actor(stage.world, barrel, &stage.body(), &stage.body(), 20);
  stage.tics(70);
  EXPECT_EQ(stage.world.actor(neighbour), nullptr);
  EXPECT_LT(stage.at(imp).health, 60);
}

TEST(Keen, TheLastOneOpensDoor666) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256), door = builder.sector(0, 0, 666);
  builder.room(room, -512, -512, 512, 512).island(door, room, 100, 100, 300, 300).thing(1, -400, 0);
  Stage stage(builder.build());
  Actor& keen = stage.spawn("CommanderKeen", 0, 200);
  damage_actor(stage.world, keen, nullptr, nullptr, 1000);
  stage.tics(35 * 8);
  EXPECT_GT(stage.world.sectors()[door].ceiling_height, to_fixed(60));
}

// ---------------------------------------------------------------- quarrels

TEST(Infighting, AnImpHitByAZombieTurnsOnIt) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 500, 0, 180);
  Actor& zombie = stage.spawn("ZombieMan", 700, 0, 180);
  imp.target_id = stage.body().id;
  damage_actor(stage.world, imp, &zombie, &zombie, 5);
  EXPECT_EQ(imp.target_id, zombie.id);
  Actor& vile = stage.spawn("Archvile", 700, 200, 180);
  Actor& other = stage.spawn("DoomImp", 500, 200, 180);
  other.target_id = stage.body().id;
  damage_actor(stage.world, other, &vile, &vile, 5);
  EXPECT_EQ(other.target_id, stage.body().id);  // arch-viles are forgiven
}

}  // namespace monster_actions_test
}  // namespace comrad::doom
