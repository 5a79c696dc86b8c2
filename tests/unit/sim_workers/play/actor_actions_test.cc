// Generic action functions, called with arguments as DECORATE gives them.
#include <gtest/gtest.h>

#include <vector>

#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/placement.h"
#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace actor_actions_test {

using test::Stage;

ActionArg number(int32_t value) { return {ActionArg::Kind::kInteger, value, 0}; }
ActionArg fixed(double value) { return {ActionArg::Kind::kFixed, static_cast<int32_t>(value * 65536), 0}; }
ActionArg range(int32_t low, int32_t high) { return {ActionArg::Kind::kRandom, low, high}; }
ActionArg state(uint32_t index) { return {ActionArg::Kind::kState, static_cast<int32_t>(index), 0}; }
ActionArg type(const Stage& stage, std::string_view name) {
  return {ActionArg::Kind::kType, static_cast<int32_t>(stage.catalog->find(name).value()), 0};
}

struct Outcome {
  bool jumps = false;
  uint32_t jump = kNoState;
};

Outcome act(Stage& stage, Actor& actor, ActionId id, std::vector<ActionArg> args = {}) {
  State called;
  called.action = id;
  ActionCall call{.world = stage.world, .self = actor, .state = called, .args = args};
  run_action(call);
  return {call.has_jump, call.jump};
}

Actor& newest(Stage& stage) { return stage.world.state().actors.back(); }

// ---------------------------------------------------------------- jumps

TEST(Jumps, TakeTheirChanceAndOneOfTheirLabels) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 300, 0);
  int jumped = 0, second = 0;
  for (int i = 0; i < 4000; ++i) {
    const Outcome outcome = act(stage, imp, ActionId::kJump, {number(64), state(5), state(6)});
    jumped += outcome.jumps, second += outcome.jumps && outcome.jump == 6;
  }
  EXPECT_NEAR(jumped / 4000.0, 0.25, 0.03);
  EXPECT_NEAR(second / 4000.0, 0.125, 0.03);
  EXPECT_TRUE(act(stage, imp, ActionId::kJump, {number(256), state(5)}).jumps);
  EXPECT_FALSE(act(stage, imp, ActionId::kJump, {number(0), state(5)}).jumps);
}

TEST(Jumps, LookAtHealthDistanceAndSight) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 300, 0, 180);
  imp.target_id = stage.body().id;
  EXPECT_TRUE(act(stage, imp, ActionId::kJumpIfHealthLower, {number(61), state(5)}).jumps);
  EXPECT_FALSE(act(stage, imp, ActionId::kJumpIfHealthLower, {number(60), state(5)}).jumps);
  EXPECT_TRUE(act(stage, imp, ActionId::kJumpIfCloser, {number(301), state(5)}).jumps);
  EXPECT_FALSE(act(stage, imp, ActionId::kJumpIfCloser, {number(300), state(5)}).jumps);
  EXPECT_TRUE(act(stage, imp, ActionId::kJumpIfTargetInLOS, {state(5), fixed(90.0)}).jumps);
  imp.angle = 0;
  EXPECT_FALSE(act(stage, imp, ActionId::kJumpIfTargetInLOS, {state(5), fixed(90.0)}).jumps);
  EXPECT_FALSE(act(stage, imp, ActionId::kCheckSight, {state(5)}).jumps);  // the player sees it
  EXPECT_TRUE(act(stage, imp, ActionId::kCheckFloor, {state(5)}).jumps);
  imp.z = to_fixed(10);
  EXPECT_FALSE(act(stage, imp, ActionId::kCheckFloor, {state(5)}).jumps);
}

TEST(Inventory, GoesToPlayersAndHealthToMonsters) {
  Stage stage;
  EXPECT_FALSE(
      act(stage, stage.body(), ActionId::kJumpIfInventory, {type(stage, "Shell"), number(5), state(5)})
          .jumps);
  act(stage, stage.body(), ActionId::kGiveInventory, {type(stage, "Shell"), number(5)});
  EXPECT_TRUE(
      act(stage, stage.body(), ActionId::kJumpIfInventory, {type(stage, "Shell"), number(5), state(5)})
          .jumps);
  Actor& imp = stage.spawn("DoomImp", 300, 0);
  imp.target_id = stage.body().id;
  EXPECT_TRUE(
      act(stage, imp, ActionId::kJumpIfInTargetInventory, {type(stage, "Shell"), number(5), state(5)}).jumps);
  act(stage, imp, ActionId::kTakeFromTarget, {type(stage, "Shell"), number(1)});
  EXPECT_FALSE(
      act(stage, imp, ActionId::kJumpIfInTargetInventory, {type(stage, "Shell"), number(5), state(5)}).jumps);
  imp.health = 10;
  act(stage, imp, ActionId::kGiveInventory, {type(stage, "Medikit"), number(1)});
  EXPECT_EQ(imp.health, 35);
  act(stage, imp, ActionId::kGiveInventory, {type(stage, "HealthBonus"), number(5)});
  EXPECT_EQ(imp.health, 40) << "so many times over";
}

TEST(Inventory, HealthIsGivenSoManyTimesAndArmourOnce) {
  Stage stage;
  stage.body().health = stage.world.state().players[0].health = 20;
  act(stage, stage.body(), ActionId::kGiveInventory, {type(stage, "Stimpack"), number(3)});
  EXPECT_EQ(stage.body().health, 50);
  act(stage, stage.body(), ActionId::kGiveInventory, {type(stage, "GreenArmor"), number(3)});
  EXPECT_EQ(stage.world.player(0).armor, 100);
}

// Probe: a thing of height 20 at each place gives to a player at the origin, whose middle is 28 up: 99 to a side are 100.6 away.
TEST(Inventory, RadiusGiveReachesMiddlesInASphereOrCube) {
  constexpr int kPlayers = 2, kMonsters = 4, kCube = 512;
  struct Case {
    int x, y, z, flags, least, gained;
  };
  for (const auto& [x, y, z, flags, least, gained] :
       {Case{95, 0, 0, kPlayers, 0, 1}, Case{99, 0, 0, kPlayers, 0, 0},
        Case{99, 0, 0, kPlayers | kCube, 0, 1}, Case{101, 0, 0, kPlayers | kCube, 0, 0},
        Case{77, 77, 0, kPlayers | kCube, 0, 1}, Case{77, 77, 0, kPlayers, 0, 0},
        Case{40, 0, 0, kPlayers, 50, 0}, Case{60, 0, 0, kPlayers, 50, 1}, Case{40, 0, 0, kMonsters, 0, 0}}) {
    Stage stage;
    stage.body().health = stage.world.state().players[0].health = 100;
    Actor& giver = stage.spawn("DoomImp", x, y);
    giver.height = to_fixed(20), giver.z = stage.body().z + to_fixed(z);
    giver.x = stage.body().x + to_fixed(x), giver.y = stage.body().y + to_fixed(y);
    act(stage, giver, ActionId::kRadiusGive,
        {type(stage, "HealthBonus"), number(100), number(flags), number(0), number(0), number(0),
         number(least)});
    EXPECT_EQ(stage.body().health, 100 + gained) << x << " " << y << " " << flags << " " << least;
  }
}

// ---------------------------------------------------------------- attacks

// Probe: A_RadiusThrust(100, 256): half of 100 less the share of the box's distance, for each pound of mass.
TEST(RadiusThrust, PushesHalfTheForceForEachPound) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 300, 0);
  imp.x = stage.body().x + to_fixed(90), imp.y = stage.body().y;  // its box begins 70 away
  act(stage, stage.body(), ActionId::kRadiusThrust, {number(100), number(256), number(0)});
  EXPECT_NEAR(imp.velocity_x, 65536 * 100.0 * (1 - 70 / 256.0) / 2 / 100, 2);
  EXPECT_EQ(imp.velocity_z, 0);
  EXPECT_EQ(stage.body().velocity_x, 0);
  act(stage, stage.body(), ActionId::kRadiusThrust, {number(100), number(256), number(1)});
  EXPECT_EQ(stage.body().velocity_x, kFracUnit / 2) << "itself, to the east";
  imp.velocity_x = 0;
  imp.set(ActorFlag::kDontThrust);
  act(stage, stage.body(), ActionId::kRadiusThrust, {number(100)});
  EXPECT_EQ(imp.velocity_x, 0);
}

TEST(CustomMissile, StartsAtItsOffsetAndTurnsByItsAngle) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 500, 0, 180);
  imp.target_id = stage.body().id;
  act(stage, imp, ActionId::kCustomMissile, {type(stage, "DoomImpBall"), number(40), number(12), number(90)});
  Actor& ball = newest(stage);
  ASSERT_EQ(stage.world.type_of(ball).name, "DoomImpBall");
  // It looks west: its right hand is north; a quarter to the left of west is south.
  EXPECT_NEAR(to_double(ball.x), 500, 0.1);
  EXPECT_NEAR(to_double(ball.y), 12 - 5, 0.1);  // half a step of 10 to the south
  EXPECT_NEAR(to_double(ball.z), 40, 0.6);
  EXPECT_NEAR(to_double(ball.velocity_y), -10, 0.1);
  EXPECT_EQ(ball.target_id, imp.id);
}

TEST(CustomMissile, FollowsItsOwnAngleWithoutATarget) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 500, 0, 90);
  act(stage, imp, ActionId::kCustomMissile, {type(stage, "DoomImpBall"), number(32)});
  EXPECT_NE(stage.world.type_of(newest(stage)).name, "DoomImpBall");  // nobody to aim at
  act(stage, imp, ActionId::kCustomMissile,
      {type(stage, "DoomImpBall"), number(32), number(0), number(0), number(2), number(-30)});
  Actor& ball = newest(stage);
  ASSERT_EQ(stage.world.type_of(ball).name, "DoomImpBall");
  EXPECT_NEAR(to_double(ball.velocity_y), 10 * 0.866, 0.1);
  EXPECT_NEAR(to_double(ball.velocity_z), -5, 0.1);  // a pitch below zero falls, as in ViZDoom
}

TEST(CustomMissile, AimsAtTheHeightOfItsTarget) {
  Stage stage;
  stage.make_player_tough();
  Actor& imp = stage.spawn("DoomImp", 600, 0, 180, 120);
  imp.set(ActorFlag::kNoGravity);
  imp.tics = -1;
  imp.target_id = stage.body().id;
  act(stage, imp, ActionId::kCustomMissile, {type(stage, "DoomImpBall")});
  stage.tics(80);
  EXPECT_GT(stage.player().damage_taken, 0);
}

TEST(CustomBulletAttack, FiresAllItsBulletsWithinItsSpread) {
  Stage stage;
  stage.make_player_tough();
  Actor& imp = stage.spawn("ZombieMan", 300, 0, 180);
  imp.target_id = stage.body().id;
  act(stage, imp, ActionId::kCustomBulletAttack,
      {number(0), number(0), number(4), number(5), type(stage, "BulletPuff"), number(0), number(2)});
  EXPECT_EQ(stage.player().damage_taken, 20);
  act(stage, imp, ActionId::kCustomBulletAttack,
      {number(0), number(0), number(1), number(5), type(stage, "BulletPuff"), number(100)});
  EXPECT_EQ(stage.player().damage_taken, 20);  // out of range
}

TEST(CustomMeleeAttack, DealsItsDamageInReachOnly) {
  Stage stage;
  stage.make_player_tough();
  Actor& zombie = stage.spawn("ZombieMan", 55, 0, 180);
  zombie.target_id = stage.body().id;
  act(stage, zombie, ActionId::kCustomMeleeAttack, {number(10)});
  EXPECT_EQ(stage.player().damage_taken, 10);
  act(stage, zombie, ActionId::kCustomMeleeAttack, {range(3, 3)});
  EXPECT_EQ(stage.player().damage_taken, 13);
  zombie.x = to_fixed(70);
  act(stage, zombie, ActionId::kCustomMeleeAttack, {number(10)});
  EXPECT_EQ(stage.player().damage_taken, 13);
}

TEST(Explode, UsesItsArgumentsAndSparesItsOwnerOnDemand) {
  Stage stage;
  stage.make_player_tough();
  Actor& bomb = stage.spawn("ExplosiveBarrel", 66, 0);
  bomb.set(ActorFlag::kShootable, false);
  bomb.target_id = stage.body().id;
  act(stage, bomb, ActionId::kExplode, {number(100), number(100), number(1)});
  EXPECT_EQ(stage.player().damage_taken, 50);  // 66 - 16 units away
  act(stage, bomb, ActionId::kExplode, {number(100), number(100), number(0)});
  EXPECT_EQ(stage.player().damage_taken, 50);
}

// ---------------------------------------------------------------- spawning

TEST(SpawnItemEx, PlacesAndPushesRelativeToItsActor) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 200, 90);
  act(stage, imp, ActionId::kSpawnItemEx,
      {type(stage, "BulletPuff"), number(30), number(10), number(5), number(2), number(0), number(1),
       number(0), number(0), number(0), number(7)});
  const Actor& made = newest(stage);
  EXPECT_NEAR(to_double(made.x), 110, 0.1);  // north is ahead, east is right
  EXPECT_NEAR(to_double(made.y), 230, 0.1);
  EXPECT_EQ(made.z, to_fixed(5));
  EXPECT_NEAR(to_double(made.velocity_y), 2, 0.01);
  EXPECT_EQ(made.velocity_z, to_fixed(1));
  EXPECT_EQ(made.thing_id, 7);
  EXPECT_EQ(made.target_id, imp.id);
}

TEST(SpawnItemEx, LeavesMonstersOutThatDoNotFit) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 200, 90);
  stage.spawn("ExplosiveBarrel", 100, 300);
  act(stage, imp, ActionId::kSpawnItemEx, {type(stage, "Demon"), number(100)});
  EXPECT_EQ(stage.count("Demon"), 0);
  act(stage, imp, ActionId::kSpawnItemEx, {type(stage, "Demon"), number(200)});
  EXPECT_EQ(stage.count("Demon"), 1);
  act(stage, imp, ActionId::kSpawnItemEx,
      {type(stage, "Demon"), number(-200), number(0), number(0), number(0), number(0), number(0), number(0),
       number(0), number(256)});
  EXPECT_EQ(stage.count("Demon"), 1);  // a chance of 256 to fail
}

TEST(Children, AreKilledAndRemovedTogether) {
  Stage stage;
  Actor& mother = stage.spawn("DoomImp", 100, 200);
  Actor& child = stage.spawn("DoomImp", 300, 200);
  Actor& other = stage.spawn("DoomImp", 500, 200);
  child.master_id = mother.id;
  act(stage, mother, ActionId::kKillChildren);
  EXPECT_LE(child.health, 0);
  EXPECT_EQ(other.health, 60);
  act(stage, mother, ActionId::kRemoveChildren, {number(1)});
  EXPECT_TRUE(child.removed);
  EXPECT_FALSE(other.removed);
}

// ---------------------------------------------------------------- fading, flags, counting

TEST(FadeOut, RemovesTheActorWhenNothingIsLeft) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 200);
  for (int i = 0; i < 3; ++i) act(stage, imp, ActionId::kFadeOut, {fixed(0.25)});
  EXPECT_FALSE(imp.removed);
  EXPECT_EQ(imp.alpha, 0.25f);
  act(stage, imp, ActionId::kFadeOut, {fixed(0.25)});
  EXPECT_TRUE(imp.removed);
}

TEST(Flags, SolidityAndShootabilityChangeWithTheLists) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 0);
  act(stage, imp, ActionId::kUnsetSolid);
  EXPECT_FALSE(imp.has(ActorFlag::kSolid));
  EXPECT_TRUE(try_teleport(stage.world, stage.body().id, to_fixed(100), 0));
  try_teleport(stage.world, stage.body().id, 0, 0);
  act(stage, imp, ActionId::kSetSolid);
  EXPECT_FALSE(try_teleport(stage.world, stage.body().id, to_fixed(100), 0));
  act(stage, imp, ActionId::kUnSetShootable);
  EXPECT_FALSE(imp.has(ActorFlag::kShootable));
  act(stage, imp, ActionId::kSetShootable);
  EXPECT_TRUE(imp.has(ActorFlag::kShootable));
}

TEST(CountdownArg, KillsWhenItsArgumentRunsOut) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 0);
  imp.args[1] = 2;
  act(stage, imp, ActionId::kCountdownArg, {number(1)});
  act(stage, imp, ActionId::kCountdownArg, {number(1)});
  EXPECT_GT(imp.health, 0);
  act(stage, imp, ActionId::kCountdownArg, {number(1)});
  EXPECT_LE(imp.health, 0);
}

TEST(Velocity, ChangesScalesAndStops) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 0, 90);
  act(stage, imp, ActionId::kChangeVelocity, {number(4), number(0), number(2), number(1)});
  EXPECT_NEAR(to_double(imp.velocity_y), 4, 0.01);
  act(stage, imp, ActionId::kScaleVelocity, {fixed(0.5)});
  EXPECT_NEAR(to_double(imp.velocity_y), 2, 0.01);
  EXPECT_EQ(imp.velocity_z, to_fixed(1));
  act(stage, imp, ActionId::kStop);
  EXPECT_EQ(imp.velocity_y, 0);
  act(stage, imp, ActionId::kThrustThing, {number(64), number(8)});
  EXPECT_NEAR(to_double(imp.velocity_y), 8, 0.01);
}

TEST(Actions, EveryOneStandsEmptyAndWildArguments) {
  // Called with nothing, and with numbers far out of any range: no crash, no overflow (run under sanitizers).
  for (const bool wild : {false, true}) {
    for (uint16_t id = 1; id < static_cast<uint16_t>(ActionId::kFreezeDeath); ++id) {
      Stage stage;
      stage.make_player_tough();
      Actor& imp = stage.spawn("DoomImp", 300, 0, 180);
      imp.target_id = imp.tracer_id = imp.master_id = stage.body().id;
      std::vector<ActionArg> args;
      if (wild)
        for (int i = 0; i < 11; ++i)
          args.push_back(i % 3 == 0 ? type(stage, "DoomImpBall")
                                    : number(i % 2 == 0 ? INT32_MAX : INT32_MIN));
      act(stage, imp, static_cast<ActionId>(id), args);
      stage.tics(3);
    }
  }
}

}  // namespace actor_actions_test
}  // namespace comrad::doom
