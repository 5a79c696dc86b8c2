// How monsters notice, hunt, walk and choose whom to fight.
#include "sim_workers/engine/play/monsters.h"

#include <gtest/gtest.h>

#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/sight.h"
#include "tests/support/allocation_count.h"
#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace monsters_test {

using test::LevelBuilder;
using test::Stage;

// ---------------------------------------------------------------- noticing

TEST(Look, NoticesWhoIsInFrontOrVeryNearButNotBehindItsBack) {
  for (const auto& [x, angle, notices] : {std::tuple{400, 180, true}, {400, 0, false}, {60, 0, true}}) {
    Stage stage;
    const uint32_t id = stage.spawn("DoomImp", x, 0, angle).id;
    stage.tics(40);
    EXPECT_EQ(stage.at(id).target_id != 0, notices) << x << ' ' << angle;
  }
}

TEST(Look, NoiseWakesWhoLooksAwayButAnAmbushWaitsForSight) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 200, -300, 264, 300);
  for (const bool ambush : {false, true}) {
    Stage stage(builder.build());
    Actor& imp = stage.spawn("DoomImp", 400, 0, 0);
    imp.set(ActorFlag::kAmbush, ambush);
    const uint32_t id = imp.id;
    stage.tics(30);
    EXPECT_EQ(stage.at(id).target_id, 0u);
    alert_monsters(stage.world, stage.body(), stage.body());
    stage.tics(30);
    EXPECT_EQ(stage.at(id).target_id != 0, !ambush);
    set_position(stage.world, stage.body().id, to_fixed(300), to_fixed(600), 0);
    stage.tics(30);
    EXPECT_EQ(stage.at(id).target_id, stage.body().id);
  }
}

TEST(Look, IgnoresPlayersWhoAreDeadOrNoTargetAndPicksTheLivingOne) {
  LevelBuilder builder = test::big_room();
  builder.thing(2, 0, 100);
  Stage stage(builder.build(), {.player_count = 2});
  stage.world.state().players[0].no_target = true;
  const uint32_t id = stage.spawn("DoomImp", 600, 50, 180).id;
  stage.tics(25);
  EXPECT_EQ(stage.at(id).target_id, stage.body(1).id);
  Stage dead(builder.build(), {.player_count = 2});
  damage_actor(dead.world, dead.body(1), nullptr, nullptr, 1000);
  const uint32_t other = dead.spawn("DoomImp", 600, 50, 180).id;
  dead.tics(25);
  EXPECT_EQ(dead.at(other).target_id, dead.body(0).id);
}

TEST(Look, DormantMonstersDoNothing) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 100, 0, 180);
  imp.set(ActorFlag::kDormant);
  const uint32_t id = imp.id;
  stage.tics(70);
  EXPECT_EQ(stage.at(id).target_id, 0u);
  EXPECT_EQ(stage.at(id).x, to_fixed(100));
}

// ---------------------------------------------------------------- walking

TEST(Chase, ADemonFindsItsWayRoundAPillarAndBites) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 200, -100, 300, 100);
  Stage stage(builder.build());
  Actor& demon = stage.spawn("Demon", 450, 0, 180);
  demon.target_id = stage.body().id;
  set_label(stage.world, demon, StateLabel::kSee);
  EXPECT_TRUE(stage.tics_until(35 * 20, [&] { return stage.player().hits_taken > 0; }));
}

TEST(Chase, AStepIsAsLongAsItsSpeedAlsoWhenItIsLongerThanItsBody) {
  for (const int speed : {8, 21, 70}) {
    Stage stage;
    Actor& demon = stage.spawn("Demon", 800, 0, 180);
    demon.speed = to_fixed(speed);
    demon.move_direction = kWest;
    EXPECT_TRUE(monster_move(stage.world, demon));
    EXPECT_EQ(demon.x, to_fixed(800 - speed));
    demon.move_direction = kNorthEast;
    EXPECT_TRUE(monster_move(stage.world, demon));
    EXPECT_EQ(demon.y, fixed_mul(to_fixed(speed), 46341));
  }
}

TEST(Chase, NothingIsSteppedThroughHoweverFastItIs) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 700, -100, 704, 100);
  Stage stage(builder.build());
  Actor& demon = stage.spawn("Demon", 760, 0, 180);
  demon.speed = to_fixed(200);
  demon.move_direction = kWest;
  EXPECT_FALSE(monster_move(stage.world, demon));
  EXPECT_GT(demon.x, to_fixed(704));
}

TEST(MonsterMove, ClimbsStairsButNeitherWallsNorDeepDrops) {
  for (const auto& [floor, walks] : {std::pair{24, true}, {25, false}, {-24, true}, {-25, false}}) {
    LevelBuilder builder;
    const uint32_t room = builder.sector(0, 256), other = builder.sector(floor, 256);
    builder.room(room, -512, -512, 512, 512).island(other, room, 0, -500, 500, 500).thing(1, 400, 0);
    Stage stage(builder.build());
    Actor& imp = stage.spawn("DoomImp", -30, 0, 0);
    imp.move_direction = kEast;
    bool moved = true;
    for (int step = 0; step < 8 && moved; ++step) moved = monster_move(stage.world, imp);
    EXPECT_EQ(moved, walks) << floor;
    if (walks) {
      stage.tics(1);
      EXPECT_EQ(stage.world.actors()[1].z, to_fixed(floor));
    }
  }
}

TEST(MonsterMove, AFlyerRisesOverALedge) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 400), block = builder.sector(100, 400);
  builder.room(room, -512, -512, 512, 512).island(block, room, 0, -512, 512, 512).thing(1, 400, 0);
  Stage stage(builder.build());
  stage.make_player_tough();
  Actor& head = stage.spawn("Cacodemon", -60, 0, 0);
  head.target_id = stage.body().id;
  const uint32_t id = head.id;
  set_label(stage.world, head, StateLabel::kSee);
  EXPECT_TRUE(stage.tics_until(35 * 20, [&] { return stage.at(id).x > to_fixed(60); }));
  EXPECT_GE(stage.at(id).z, to_fixed(100));
}

TEST(Chase, TheFrightenedRunAwayAndAlmostNeverFight) {
  Stage stage;
  Actor& demon = stage.spawn("Demon", 200, 0, 180);
  demon.set(ActorFlag::kFrightened);
  demon.target_id = stage.body().id;
  const uint32_t id = demon.id;
  set_label(stage.world, demon, StateLabel::kSee);
  stage.tics(70);
  EXPECT_GT(stage.at(id).x, to_fixed(400));
}

TEST(Chase, OnTheHighestSkillDemonsAreTwiceAsFast) {
  const auto way = [](int skill) {
    Stage stage(test::big_room().build(), {.skill = skill});
    stage.make_player_tough();
    Actor& demon = stage.spawn("Demon", 1000, 0, 180);
    demon.target_id = stage.body().id;
    demon.move_direction = kWest;  // not from the walk east that it is born with
    const uint32_t id = demon.id;
    set_label(stage.world, demon, StateLabel::kSee);
    stage.tics(70);
    return to_double(to_fixed(1000) - stage.at(id).x);
  };
  EXPECT_NEAR(way(3), 350, 30);
  EXPECT_NEAR(way(5), 700, 60);
}

TEST(Chase, ATargetThatDiesIsForgotten) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 300, 0, 180);
  imp.target_id = stage.body().id;
  const uint32_t id = imp.id;
  set_label(stage.world, imp, StateLabel::kSee);
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 1000);
  stage.tics(60);  // an attack that has begun ends first
  EXPECT_EQ(stage.at(id).target_id, 0u);
  EXPECT_TRUE(stage.is_in(stage.at(id), StateLabel::kSpawn, 2));
}

TEST(Wander, WalksInStraightStretchesAndStaysInTheRoom) {
  Stage stage;
  Actor& rabbit = stage.spawn("ZombieMan", 300, 300);
  rabbit.speed = to_fixed(24);
  rabbit.tics = -1;
  int kept = 0, steps = 0;
  Direction last = kNoDirection;
  int64_t length = 0;
  for (int i = 0; i < 500; ++i) {
    const Fixed x = rabbit.x, y = rabbit.y;
    wander(stage.world, rabbit);
    length += approximate_distance(rabbit.x - x, rabbit.y - y) >> kFracBits;
    kept += rabbit.move_direction == last;
    last = rabbit.move_direction;
    ++steps;
  }
  EXPECT_GT(kept, steps * 8 / 10);
  EXPECT_LT(kept, steps);
  EXPECT_GT(length, 500 * 18);
  EXPECT_LT(std::abs(to_double(rabbit.x)), 1024);
}

// ---------------------------------------------------------------- attacking

TEST(CheckMissileRange, TheNearerTheMoreOftenAndAlwaysWhenHit) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 0, 0, 180);
  imp.target_id = stage.body().id;
  const auto share = [&](int distance) {
    imp.x = to_fixed(distance);
    int fired = 0;
    for (int i = 0; i < 4000; ++i) fired += check_missile_range(stage.world, imp);
    return fired / 4000.0;
  };
  // A draw of 0..255 has to reach distance - 64, 200 at most.
  EXPECT_NEAR(share(164), 156 / 256.0, 0.03);
  EXPECT_NEAR(share(900), 56 / 256.0, 0.03);
  imp.set(ActorFlag::kJustHit);
  EXPECT_TRUE(check_missile_range(stage.world, imp));
  EXPECT_FALSE(imp.has(ActorFlag::kJustHit));
  imp.reaction_tics = 1;
  EXPECT_EQ(share(164), 0.0);
}

TEST(CheckMeleeRange, ReachesFortyFourUnitsBeyondTheTargetsRadius) {
  Stage stage;
  Actor& imp = stage.spawn("DoomImp", 59, 0, 180);
  imp.target_id = stage.body().id;
  EXPECT_TRUE(check_melee_range(stage.world, imp));
  imp.x = to_fixed(60);
  EXPECT_FALSE(check_melee_range(stage.world, imp));
  imp.x = to_fixed(50), imp.z = to_fixed(57);
  EXPECT_FALSE(check_melee_range(stage.world, imp));  // over its head
}

TEST(FriendlyMonsters, FightMonstersAndNotPlayers) {
  Stage stage;
  Actor& ally = stage.spawn("BaronOfHell", 200, 0, 180);
  ally.set(ActorFlag::kFriendly);
  const uint32_t foe = stage.spawn("DoomImp", 500, 0, 180).id;
  EXPECT_TRUE(stage.tics_until(35 * 30, [&] { return stage.at(foe).health <= 0; }));
  EXPECT_EQ(stage.player().attacker_id == ally.id, false);
}

TEST(Hate, MonstersGoForTheActorsOfTheirHatedIdBeforePlayers) {
  Stage stage;
  Actor& core = stage.spawn("HellKnight", 500, 0, 0);
  core.thing_id = 77;
  core.tics = -1;  // it does not fight back
  const uint32_t core_id = core.id;
  Actor& demon = stage.spawn("Demon", 300, 0, 180);
  demon.hate_thing_id = 77;
  demon.set(ActorFlag::kNoSightCheck);
  const uint32_t demon_id = demon.id;
  stage.tics(40);
  EXPECT_EQ(stage.at(demon_id).target_id, core_id);
  EXPECT_TRUE(stage.tics_until(35 * 10, [&] { return stage.at(core_id).health < 500; }));
  // An id that nobody has makes it ignore players.
  Stage calm;
  Actor& head = calm.spawn("Cacodemon", 300, 0, 180);
  head.hate_thing_id = 100;
  const uint32_t head_id = head.id;
  calm.tics(200);
  EXPECT_EQ(calm.at(head_id).target_id, 0u);
}

TEST(Hate, TwoOfOnePartyForgiveEachOtherAndPlayersAreForgivenOnDemand) {
  Stage stage;
  Actor& one = stage.spawn("Demon", 300, 0);
  Actor& other = stage.spawn("DoomImp", 500, 0);
  EXPECT_TRUE(may_turn_against(stage.world, one, other));
  one.hate_thing_id = other.hate_thing_id = 5;
  EXPECT_FALSE(may_turn_against(stage.world, one, other));
  EXPECT_TRUE(may_turn_against(stage.world, one, stage.body()));
  one.set(ActorFlag::kNoHatePlayers);
  EXPECT_FALSE(may_turn_against(stage.world, one, stage.body()));
  EXPECT_FALSE(may_turn_against(stage.world, one, one));
  Actor& busy = stage.spawn("Demon", 300, 300);
  busy.threshold = 5;
  EXPECT_FALSE(may_turn_against(stage.world, busy, other));
  busy.set(ActorFlag::kQuickToRetaliate);
  EXPECT_TRUE(may_turn_against(stage.world, busy, other));
}

TEST(Patrol, WalksFromPointToPointUntilItSeesAnEnemy) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 60, -900, 90, 900);
  builder.thing(9024, 400, 400, 0, 50).thing(9024, 800, -400, 0, 51);
  Stage stage(builder.build());
  Actor* first = stage.world.find_thing(50);
  Actor* second = stage.world.find_thing(51);
  ASSERT_TRUE(first != nullptr && second != nullptr);
  first->args[0] = 51, second->args[0] = 50;
  Actor& guard = stage.spawn("ZombieMan", 300, -300, 0);
  guard.goal_id = first->id;
  const uint32_t id = guard.id;
  EXPECT_TRUE(stage.tics_until(35 * 40, [&] { return stage.at(id).goal_id == second->id; }));
  EXPECT_LT(distance_between(stage.at(id), *first), to_fixed(80));
  EXPECT_TRUE(stage.tics_until(35 * 60, [&] { return stage.at(id).goal_id == first->id; }));
  EXPECT_LT(distance_between(stage.at(id), *second), to_fixed(80));
  set_position(stage.world, stage.body().id, to_fixed(700), 0, 0);
  EXPECT_TRUE(stage.tics_until(35 * 20, [&] { return stage.at(id).target_id == stage.body().id; }));
}

// ---------------------------------------------------------------- skulls, bosses

TEST(SkullStruck, AChargeEndsAtTheBodyItBitesOrAtAWall) {
  Stage stage;
  Actor& skull = stage.spawn("LostSoul", 100, 0, 180);
  skull.target_id = stage.body().id;
  skull.set(ActorFlag::kSkullFly);
  skull.velocity_x = to_fixed(-20);
  skull.tics = -1;
  const uint32_t id = skull.id;
  stage.tics(6);
  EXPECT_FALSE(stage.at(id).has(ActorFlag::kSkullFly));
  EXPECT_EQ(stage.at(id).velocity_x, 0);
  const int32_t lost = 100 - stage.player().health;
  EXPECT_GE(lost, 3);
  EXPECT_LE(lost, 24);
  EXPECT_EQ(lost % 3, 0);

  Actor& other = stage.spawn("LostSoul", 900, 500, 0);
  other.set(ActorFlag::kSkullFly);
  other.velocity_x = to_fixed(20);
  other.tics = -1;
  const uint32_t other_id = other.id;
  stage.tics(12);
  EXPECT_FALSE(stage.at(other_id).has(ActorFlag::kSkullFly));
}

TEST(BossDeath, TheLastMancubusOfMap07LowersTheFloor) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256), wall = builder.sector(100, 256, 666);
  builder.room(room, -512, -512, 512, 512).island(wall, room, 100, 100, 300, 300).thing(1, -400, 0);
  Level level = *builder.build();
  level.name = "MAP07";
  Stage stage(std::make_shared<const Level>(level));
  Actor& first = stage.spawn("Fatso", -200, -200);
  Actor& second = stage.spawn("Fatso", 200, -200);
  first.health = 0;
  boss_death(stage.world, first);
  stage.tics(35);
  EXPECT_EQ(stage.world.sectors()[wall].floor_height, to_fixed(100));
  second.health = 0;
  boss_death(stage.world, second);
  stage.tics(35 * 6);
  EXPECT_EQ(stage.world.sectors()[wall].floor_height, 0);
}

// ---------------------------------------------------------------- all together

/// A crowd of every kind hunts two players round pillars.
std::unique_ptr<Stage> crowd(uint64_t seed) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 150, 150, 250, 250).pillar(0, -300, 100, -200, 400).pillar(0, 100, -400, 400, -300);
  builder.thing(2, 0, 64);
  auto stage = std::make_unique<Stage>(builder.build(), WorldOptions{.player_count = 2, .seed = seed});
  stage->make_player_tough();
  int place = 0;
  for (const char* type : {"ZombieMan", "ShotgunGuy", "ChaingunGuy", "DoomImp", "Demon", "Spectre",
                           "LostSoul", "Cacodemon", "PainElemental", "HellKnight", "BaronOfHell",
                           "Arachnotron", "Fatso", "Revenant", "Archvile", "Cyberdemon"})
    for (int i = 0; i < 2; ++i, ++place)
      stage->spawn(type, -900 + 120 * (place % 15), place < 15 ? 800 : place < 30 ? -800 : 600, 0);
  return stage;
}

TEST(Monsters, ABrawlRunsTheSameFromTheSameSeedAndNotFromAnother) {
  const auto one = crowd(1), same = crowd(1), other = crowd(2);
  for (int i = 0; i < 20; ++i) {
    for (Stage* stage : {one.get(), same.get(), other.get()}) stage->tics(35);
    ASSERT_EQ(one->world.hash(), same->world.hash()) << "second " << i;
  }
  EXPECT_NE(one->world.hash(), other->world.hash());
  EXPECT_GT(one->player(0).damage_taken + one->player(1).damage_taken, 100);
}

TEST(Monsters, HuntingAllocatesNothing) {
  Stage stage;
  stage.make_player_tough();
  for (int i = 0; i < 8; ++i) stage.spawn(i % 2 == 0 ? "DoomImp" : "ZombieMan", 700, 100 * i - 400, 180);
  stage.tics(35 * 20);  // buffers grow to their size
  const uint64_t before = comrad::test::allocations_of_this_thread();
  stage.tics(35 * 20);
  EXPECT_EQ(comrad::test::allocations_of_this_thread() - before, 0u);
}

// ---------------------------------------------------------------- being hit

TEST(DamageThrust, MovesTheOneThatIsHitUnlessEitherSideForbidsIt) {
  for (const auto& [target_flag, inflictor_flag, is_pushed] :
       {std::tuple{ActorFlag::kCount, ActorFlag::kCount, true},
        {ActorFlag::kDontThrust, ActorFlag::kCount, false},
        {ActorFlag::kNoClip, ActorFlag::kCount, false},
        {ActorFlag::kCount, ActorFlag::kNoDamageThrust, false},
        {ActorFlag::kCount, ActorFlag::kDontThrust, true}}) {
    Stage stage;
    const uint32_t id = stage.spawn("Demon", 200, 0, 180).id;
    if (target_flag != ActorFlag::kCount) stage.at(id).set(target_flag);
    if (inflictor_flag != ActorFlag::kCount) stage.body().set(inflictor_flag);
    damage_actor(stage.world, stage.at(id), &stage.body(), &stage.body(), 20);
    EXPECT_EQ(stage.at(id).health, 130);
    EXPECT_EQ(stage.at(id).velocity_x > 0, is_pushed);
    EXPECT_EQ(stage.at(id).velocity_x != 0, is_pushed);
  }
}

TEST(TypedDamage, LooksForItsOwnPainStateWithoutAllocating) {
  auto catalog = std::make_shared<ActorCatalog>();
  std::vector<std::string> warnings;
  ASSERT_TRUE(
      parse_decorate("actor Kindling { health 1000 painchance 256 +SHOOTABLE radius 16 height 16\n"
                     "states { Spawn: TNT1 A -1 stop Pain: TNT1 B 5 goto Spawn\n"
                     "Pain.Fire: TNT1 C 5 goto Spawn Pain.FireBolt: TNT1 D 5 goto Spawn } }",
                     "test", catalog.get(), &warnings));
  Stage stage(test::big_room().build(), {}, catalog);
  Actor& kindling = stage.spawn("Kindling", 200, 0);
  const auto frame_after = [&](DamageType type) {
    damage_actor(stage.world, kindling, nullptr, nullptr, 1, type);
    return stage.catalog->state(kindling.state).frame;
  };
  const uint64_t before = comrad::test::allocations_of_this_thread();
  EXPECT_EQ(frame_after(DamageType::kFire), 2);
  EXPECT_EQ(frame_after(DamageType::kInstantDeath), 1) << "no separate state: any pain";
  EXPECT_EQ(frame_after(DamageType::kFire), 2);
  EXPECT_EQ(comrad::test::allocations_of_this_thread() - before, 0u);
}

}  // namespace monsters_test
}  // namespace comrad::doom
