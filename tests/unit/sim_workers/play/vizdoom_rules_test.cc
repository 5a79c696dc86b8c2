// Rules of movement and damage as ViZDoom 1.3.2 was measured to have them, one number after the other. Each probe was
// a map of the same shape, played tic by tic with the same keys.
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/acs/map_calls.h"
#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/play/weapons.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/specials/movers.h"
#include "sim_workers/engine/specials/sector_bodies.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/behavior_builder.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace vizdoom_rules_test {

constexpr int kUpperFloor = 100;

const std::shared_ptr<const ActorCatalog>& catalog() {
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  return kCatalog;
}

/// A room of 1024 x 512 with its floor at 0, whose eastern part, from x = 512 on, lies `step` higher.
std::shared_ptr<const Level> cliff(int step, int ceiling, int start_x, int start_degrees = 0) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, ceiling), upper = builder.sector(step, ceiling);
  builder.room(room, 0, -256, 1024, 256)
      .island(upper, room, 512, -240, 1008, 240)
      .thing(1, start_x, 0, start_degrees);
  return builder.build();
}

struct Game {
  explicit Game(std::shared_ptr<const Level> level, WorldOptions options = {})
      : world(std::move(level), catalog()) {
    reset_world(world, options);
    for (int player = 0; player < options.player_count; ++player) world.body_of(player)->reaction_tics = 0;
  }
  Actor& body() { return *world.body_of(0); }
  void tic(const Buttons& buttons = {}) { run_tic(world, {&buttons, 1}); }
  /// Tics until its feet leave the ground while the jump key is held; -1: not within `limit`.
  int tics_to_jump(int limit) {
    Buttons jump;
    jump.jump = true;
    for (int tics = 1; tics <= limit; ++tics) {
      tic(jump);
      if (body().z > body().floor_z) return tics;
    }
    return -1;
  }
  World world;
};

// ---------------------------------------------------------------- jumps

// Probe: from a ledge of each height, jump held from the moment of leaving it. ViZDoom lands with these velocities and
// is in the air again so many tics after the landing: 4..32 (-3..-8): 1; 36 (-9) and more: 7.
TEST(VizdoomRules, AFallFasterThanEightDelaysTheNextJumpBySevenTics) {
  const std::vector<std::pair<int, int>> tics_after_landing = {{8, 1},  {16, 1}, {24, 1}, {32, 1},
                                                               {36, 7}, {48, 7}, {64, 7}, {256, 7}};
  for (const auto& [height, expected] : tics_after_landing) {
    Game game(cliff(height, 1024, 560, 180));
    Buttons run;
    run.forward = run.speed = true;
    while (game.body().z == to_fixed(height)) game.tic(run);
    while (game.body().z > 0) game.tic();
    EXPECT_EQ(game.tics_to_jump(20), expected) << "from " << height;
  }
}

// Probe: jump held on flat ground. Feet at 8, 15, ... and, 23 tics after the first jump, 8 again.
TEST(VizdoomRules, AHeldJumpComesBackEvery23Tics) {
  Game game(cliff(0, 1024, 200));
  Buttons jump;
  jump.jump = true;
  std::vector<int> risen;
  Fixed before = 0;
  for (int tic = 0; tic < 60; ++tic) {
    game.tic(jump);
    if (before == 0 && game.body().z == to_fixed(8)) risen.push_back(tic);
    before = game.body().z;
  }
  EXPECT_EQ(risen, (std::vector<int>{0, 23, 46}));
}

// Probe: a jump onto a ledge that is reached while the body still rises; it flies on and lands with -4. ViZDoom
// waits 7 tics after that landing, because the step up was none.
TEST(VizdoomRules, SteppingUpWhileRisingIsNoLanding) {
  Game game(cliff(40, 512, 480));
  Buttons keys;
  keys.jump = keys.forward = true;
  while (game.body().z != to_fixed(40) || game.body().velocity_z != 0) {
    game.tic(keys);
    ASSERT_LT(game.world.tic_count(), 200u);
  }
  ASSERT_EQ(game.body().z, to_fixed(40));
  EXPECT_EQ(game.tics_to_jump(20), 7);
}

// Probe: a jump under a ceiling of 56, where nothing moves; the script then carries the player to a high room, where
// the key is held. First in the air: 18 tics after the first jump, however early it is moved.
TEST(VizdoomRules, AJumpThatACeilingSwallowedIsForgottenAfter18Tics) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 512), low = builder.sector(0, 56);
  builder.room(room, 0, -256, 512, 256).island(low, room, 16, -240, 256, 240).thing(1, 128, 0);
  Game game(builder.build());
  Buttons jump;
  jump.jump = true;
  game.tic(jump);
  ASSERT_EQ(game.body().z, 0);
  for (int tic = 0; tic < 5; ++tic) game.tic();
  set_position(game.world, game.body().id, to_fixed(400), 0, 0);
  EXPECT_EQ(game.tics_to_jump(40), 18 - 5);
}

// Probe: crouching for 25 tics, then the jump key under ceilings of 58..92. Up to 60 nobody ever jumps; from 61 on
// the feet leave the ground.
TEST(VizdoomRules, StandingUpForAJumpNeedsSixtyOneUnits) {
  for (const auto& [ceiling, jumps] :
       std::vector<std::pair<int, bool>>{{58, false}, {60, false}, {61, true}, {92, true}}) {
    Game game(cliff(0, ceiling, 200), {.player_count = 1, .allow_crouch = true});
    Buttons crouch;
    crouch.crouch = true;
    for (int tic = 0; tic < 25; ++tic) game.tic(crouch);
    ASSERT_EQ(game.body().height, to_fixed(28));
    EXPECT_EQ(game.tics_to_jump(60) > 0, jumps) << "ceiling " << ceiling;
  }
}

// ---------------------------------------------------------------- being put somewhere

struct Put {
  int x, z;
  bool fits;
  std::vector<int> heights;  ///< in the tics after it, where measured
};

// Probe: SetActorPosition beside a ledge of 100 at x = 512 under a ceiling of 200; the radius is 16, so from 497 to 511
// the box hangs over the ledge.
const std::vector<Put> kPuts = {
    {440, -10, false, {}},
    {495, 50, true, {50, 49, 47, 44, 40, 35}},
    {497, 0, true, {0, 0}},
    {497, 20, true, {20, 19, 17, 14, 10, 5, 0, 0}},
    {504, 99, true, {99, 98, 96, 93, 89}},
    {504, 100, true, {100, 99, 97, 94, 90}},
    {504, 120, true, {120, 119, 117, 114, 110, 105, 99, 92, 84}},
    {511, 144, true, {144, 143, 141}},
    {511, 145, false, {}},
    {513, 99, false, {}},
    {513, 100, true, {100, 100}},
    {520, 101, true, {101, 100, 100}},
};

TEST(VizdoomRules, ABodyThatAScriptPutsSomewhereIsHeldByTheFloorOfItsCentre) {
  for (const Put& put : kPuts) {
    SCOPED_TRACE("x = " + std::to_string(put.x) + ", z = " + std::to_string(put.z));
    Game game(cliff(kUpperFloor, 200, 200));
    EXPECT_EQ(put_where_it_fits(game.world, game.body(), to_fixed(put.x), 0, to_fixed(put.z)), put.fits);
    EXPECT_EQ(game.body().x, to_fixed(put.fits ? put.x : 200));
    for (const int height : put.heights) {
      game.tic();
      EXPECT_EQ(game.body().z, to_fixed(height));
    }
  }
}

// Probe: Spawn("Clip") and Spawn("ZombieMan") at the same places: 504 takes heights from 0 on, 520 from 100 on.
TEST(VizdoomRules, SpawnChecksTheFloorOfTheCentreToo) {
  for (const char* name : {"Clip", "ZombieMan"}) {
    Game game(cliff(kUpperFloor, 200, 100));
    const uint32_t type = catalog()->find(name).value();
    const auto spawns = [&](int x, int z) {
      return spawn_actor(game.world, type, to_fixed(x), 0, to_fixed(z), 0, 0, false).has_value();
    };
    EXPECT_TRUE(spawns(490, 0)) << name;
    EXPECT_FALSE(spawns(560, 90)) << name;
    EXPECT_TRUE(spawns(620, 100)) << name;
    Game beside(cliff(kUpperFloor, 200, 100));
    EXPECT_TRUE(spawn_actor(beside.world, type, to_fixed(504), 0, to_fixed(50), 0, 0, false)) << name;
  }
}

// Probe: Thing_Move to a spot at x = 504: z = 0 there, where Teleport puts the player on the ledge, z = 100.
TEST(VizdoomRules, ThingMoveUsesTheFloorOfTheCentreAndTeleportThatOfTheBox) {
  constexpr int kMapSpot = 9001, kTeleportDestination = 14, kThingMove = 125;
  for (const bool teleports : {false, true}) {
    test::LevelBuilder builder;
    const uint32_t room = builder.sector(0, 200), upper = builder.sector(kUpperFloor, 200);
    builder.room(room, 0, -256, 1024, 256).island(upper, room, 512, -240, 1008, 240).thing(1, 200, 0);
    builder.thing(teleports ? kTeleportDestination : kMapSpot, 504, 0, 0, 50);
    Game game(builder.build());
    if (teleports) {
      EXPECT_TRUE(teleport_to(game.world, game.body(), 50, 0, false, false));
    } else {
      spawn_actor(game.world, catalog()->find("MapSpot").value(), to_fixed(504), 0, 0, 0, 50, true);
      SpecialCall call{.number = kThingMove, .args = {0, 50, 1, 0, 0}, .activator = &game.body()};
      EXPECT_NE(game.world.events().run_special(game.world, call), 0);
    }
    EXPECT_EQ(game.body().x, to_fixed(504));
    EXPECT_EQ(game.body().z, 0) << "in that tic";
    game.tic();
    EXPECT_EQ(game.body().z, to_fixed(teleports ? kUpperFloor : 0));
  }
}

// ---------------------------------------------------------------- partners

// Probe: a pistol shot of 15 from (128, 0) at the partner at (328, 0), in a cooperative network game. Its places of the
// next tics: 329.875, 331.57422, 333.11414; health 100, and neither side's counts of hits and damage change.
TEST(VizdoomRules, AShotPushesAPartnerAndDoesNotHurtIt) {
  test::LevelBuilder builder;
  builder.room(builder.sector(0, 256), 0, -256, 2048, 256).thing(1, 128, 0).thing(2, 328, 0, 180);
  Game game(builder.build(), {.player_count = 2});
  Actor& shooter = *game.world.body_of(0);
  Actor& partner = *game.world.body_of(1);
  EXPECT_EQ(damage_actor(game.world, partner, &shooter, &shooter, 15, DamageType::kNormal), 0);
  EXPECT_EQ(partner.velocity_x, to_fixed(1) * 15 / 8);
  for (const double x : {329.875, 331.57422, 333.11414}) {
    game.tic();
    EXPECT_NEAR(static_cast<double>(partner.x) / kFracUnit, x, 1e-5);
  }
  EXPECT_EQ(partner.health, 100);
  EXPECT_EQ(game.world.player(1).damage_taken, 0);
  EXPECT_EQ(game.world.player(1).hits_taken, 0);
  EXPECT_EQ(game.world.player(1).damage_flash, 0);
  EXPECT_EQ(game.world.player(0).hits_dealt, 0);
  EXPECT_EQ(game.world.player(0).damage_dealt, 0);
}

// ---------------------------------------------------------------- found by random games

/// A room of 1024 x 512 with a deathmatch start in its east.
test::LevelBuilder plain_room() {
  test::LevelBuilder builder;
  builder.room(builder.sector(0, 256, 1), 0, -256, 1024, 256).thing(1, 128, 0);
  return builder;
}

/// Puts the player on the barrel at (400, 0).
void stand_on_barrel(Game& game) {
  set_position(game.world, game.body().id, to_fixed(400), 0, to_fixed(42));
  game.tic();
  ASSERT_EQ(game.body().z, to_fixed(42)) << "it stands on the barrel";
}

// Probe: GetActorX(20) with two things of id 20, after Thing_ChangeTID of a third, and after SpawnForced.
TEST(VizdoomRules, ScriptsMeetTheActorThatGotItsIdLastFirst) {
  test::LevelBuilder room = plain_room();
  room.thing(2011, 200, 200, 0, 5).thing(2011, 210, 200, 0, 20).thing(2011, 220, 200, 0, 20);
  Game game(room.build());
  EXPECT_EQ(game.world.find_thing(20)->x, to_fixed(220));
  game.world.set_thing_id(*game.world.find_thing(5), 20);
  EXPECT_EQ(game.world.find_thing(20)->x, to_fixed(200));
  const Actor* second = game.world.find_thing(20, game.world.find_thing(20)->thing_order);
  EXPECT_EQ(second->x, to_fixed(220));
  EXPECT_EQ(game.world.find_thing(20, game.world.find_thing(20, second->thing_order)->thing_order), nullptr);
}

// Probe: Floor_RaiseByValue(1, 16, 24) from a script under the player: it stands at 2, 4, 6 from that tic on.
TEST(VizdoomRules, AMoverThatAScriptStartsMovesInTheSameTic) {
  acs::test::BehaviorBuilder code;
  code.script(1, static_cast<int>(acs::ScriptType::kEnter))
      .op(bytecode::PCode::kDelayDirect, {2})
      .push({1, 16, 24})
      .op(bytecode::PCode::kLspec3, {23})
      .end();
  const auto behavior = acs::Behavior::load(code.build(), "TEST");
  ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
  World world(plain_room().build(), catalog(), *behavior);
  reset_world(world, {});
  std::vector<int> heights;
  for (int tic = 0; tic < 5; ++tic) {
    run_tic(world, {});
    heights.push_back(world.sectors()[0].floor_height / kFracUnit);
  }
  EXPECT_EQ(heights, (std::vector<int>{0, 0, 2, 4, 6}));
}

// Probe: a sector of gravity 0.25; a body that falls into it, and one that walks off a ledge into it, which starts with 0.5.
TEST(VizdoomRules, ASectorsGravityPullsWhatIsInIt) {
  Game game(plain_room().build());
  game.world.state().sectors[0].gravity = kFracUnit / 4;
  set_position(game.world, game.body().id, to_fixed(400), 0, to_fixed(100));
  game.tic();
  EXPECT_EQ(game.body().velocity_z, -kFracUnit / 4);
  game.tic();
  EXPECT_EQ(game.body().velocity_z, -kFracUnit / 2);
}

// Probe: ThrustThing, A_Recoil and blows leave VIEW_HEIGHT at 41; the keys do not.
TEST(VizdoomRules, OnlyWhatTheKeysPushMakesTheViewBob) {
  Game blown(plain_room().build()), walking(plain_room().build());
  blown.body().velocity_x = to_fixed(10);
  Buttons keys;
  keys.forward = true;
  Fixed blown_most = 0, walking_most = 0;
  for (int tic = 0; tic < 20; ++tic) {
    blown.tic();
    walking.tic(keys);
    const auto rise = [](Game& game) {
      return std::abs(game.world.player(0).view_z - game.body().z - to_fixed(41));
    };
    blown_most = std::max(blown_most, rise(blown)), walking_most = std::max(walking_most, rise(walking));
  }
  EXPECT_EQ(blown_most, 0);
  EXPECT_GT(walking_most, to_fixed(1));
}

// Probe: Sector_SetCurrent and Sector_SetWind in sectors of special 0, 512, 2048, 4096, 8192 and 32768: 4096 alone feels them, from
// the tic of the script on.
TEST(VizdoomRules, CurrentsAreFeltWhereTheSectorHasThem) {
  acs::test::BehaviorBuilder code;
  code.script(1, static_cast<int>(acs::ScriptType::kEnter))
      .op(bytecode::PCode::kDelayDirect, {2})
      .push({1, 60, 0, 0})
      .op(bytecode::PCode::kLspec4, {Special::kSector_SetCurrent})
      .end();
  const auto behavior = acs::Behavior::load(code.build(), "TEST");
  ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
  for (const int32_t special : {0, 512, 4096, 8192}) {
    World world(plain_room().build(), catalog(), *behavior);
    reset_world(world, {});
    world.state().sectors[0].special = special;
    for (int tic = 0; tic < 3; ++tic) {
      EXPECT_EQ(world.body(0).velocity_x, 0) << tic;
      run_tic(world, {});
    }
    EXPECT_EQ(world.body(0).velocity_x > 0, special == 4096) << special;
  }
}

// Probe: a run off a barrel: the first tic beside it has its friction, and a fall of 1, not of a ledge's 2.
TEST(VizdoomRules, WhoLeavesABodyIsSlowedOnceMoreAndFallsAsFromNoLedge) {
  Game game(plain_room().thing(2035, 400, 0).build());
  ASSERT_NO_FATAL_FAILURE(stand_on_barrel(game));
  game.body().velocity_x = to_fixed(10);
  for (int tic = 0; tic < 10 && game.body().velocity_z == 0; ++tic) {
    const Fixed before = game.body().velocity_x;
    game.tic();
    EXPECT_EQ(game.body().velocity_x, fixed_mul(before, 0xE800)) << tic;
  }
  EXPECT_EQ(game.body().velocity_z, -kFracUnit);
}

// Probe: a dormant thing 32 above the floor: GetActorVelZ is -1 after the first tic.
TEST(VizdoomRules, WhatIsDormantFalls) {
  test::LevelBuilder room = plain_room();
  room.thing(2012, 400, 0, 0, 7);
  Game game(room.build());
  Actor& kit = *game.world.find_thing(7);
  kit.set(ActorFlag::kDormant);
  kit.z = to_fixed(32);
  game.tic();
  EXPECT_EQ(kit.velocity_z, -kFracUnit);
}

// Probe: CAMERA_FOV after Teleport: 135, 128, ... 93, 90.
TEST(VizdoomRules, ATeleportWidensTheViewForSevenTics) {
  test::LevelBuilder room = plain_room();
  room.thing(14, 600, 0, 0, 90);
  Game game(room.build());
  const SpecialCall call{.number = 70, .args = {90, 0, 0, 0, 0}, .activator = &game.body()};
  EXPECT_NE(game.world.events().run_special(game.world, call), 0);
  std::vector<int> degrees;
  for (int tic = 0; tic < 8; ++tic) {
    degrees.push_back(game.world.player(0).field_of_view);
    game.tic();
  }
  EXPECT_EQ(degrees, (std::vector<int>{135, 128, 121, 114, 107, 100, 93, 90}));
}

// Probe: -deathmatch with a thing 1 and three things 11: the first of these, whatever the seed.
TEST(VizdoomRules, DeathmatchBeginsAtItsOwnStarts) {
  for (const bool deathmatch : {false, true}) {
    test::LevelBuilder room = plain_room();
    room.thing(11, 600, 0).thing(11, 700, 0);
    Game game(room.build(), {.deathmatch = deathmatch});
    EXPECT_EQ(game.body().x, to_fixed(deathmatch ? 600 : 128));
  }
}

// Probe: death by a crusher or by one's own rocket, alone: FRAGCOUNT is -1.
TEST(VizdoomRules, ADeathByTheMapCostsAFrag) {
  Game game(plain_room().build());
  damage_actor(game.world, game.body(), nullptr, nullptr, 1000);
  EXPECT_EQ(game.world.player(0).frag_count, -1);
}

// Probe: GiveInventory of what gives a power: CheckInventory of it is 0, of the power 1.
TEST(VizdoomRules, WhatGivesAPowerIsNotKept) {
  Game game(plain_room().build());
  const auto type = [&](std::string_view name) { return game.world.catalog().find(name).value(); };
  for (const char* const name : {"InvulnerabilitySphere", "BlurSphere", "RadSuit", "Infrared", "Allmap"}) {
    give_item(game.world, 0, type(name), 1);
    EXPECT_EQ(count_item(game.world, 0, type(name)), 0) << name;
  }
  EXPECT_EQ(count_item(game.world, 0, type("PowerInvulnerable")), 1);
}

// Probe: ALTATTACK with a weapon that has AltFire: its state, its ammunition, and not while ATTACK fires.
TEST(VizdoomRules, TheOtherTriggerFiresAltFireWithTheSecondAmmunition) {
  auto own = std::make_shared<ActorCatalog>();
  std::vector<std::string> warnings;
  ASSERT_TRUE(parse_decorate(R"(actor TwoBarrels : Weapon 20400 { Weapon.AmmoType "Clip" Weapon.AmmoUse 1
      Weapon.AmmoType2 "Cell" Weapon.AmmoUse2 3 States {
      Ready: PISG A 1 A_WeaponReady loop  Select: PISG A 1 A_Raise loop  Deselect: PISG A 1 A_Lower loop
      Fire: PISG A 4 A_FireBullets(0, 0, 1, 5, "BulletPuff", 1) goto Ready
      AltFire: PISG A 8 A_FireBullets(0, 0, 1, 5, "BulletPuff", 1) goto Ready } })",
                             "test", own.get(), &warnings));
  World world(plain_room().build(), own);
  reset_world(world, {});
  const auto type = [&](std::string_view name) { return own->find(name).value(); };
  give_item(world, 0, type("Cell"), 7);
  give_item(world, 0, type("TwoBarrels"), 1);
  select_weapon(world, 0, type("TwoBarrels"));
  Buttons keys;
  for (int tic = 0; tic < 60; ++tic) run_tic(world, {&keys, 1});
  ASSERT_EQ(world.player(0).ready_weapon, type("TwoBarrels"));
  const int32_t clips = count_item(world, 0, type("Clip"));
  keys.alt_attack = true;
  for (int tic = 0; tic < 60; ++tic) run_tic(world, {&keys, 1});
  EXPECT_EQ(count_item(world, 0, type("Cell")), 1) << "two shots of three";
  EXPECT_EQ(count_item(world, 0, type("Clip")), clips);
}

constexpr const char* kWeaponStates = R"(
      Ready: PISG A 1 A_WeaponReady loop  Select: PISG A 1 A_Raise loop  Deselect: PISG A 1 A_Lower loop
      Fire: PISG A 4 A_FireBullets(0, 0, 1, 5, "BulletPuff", 1) goto Ready
      AltFire: PISG A 8 A_FireBullets(0, 0, 1, 5, "BulletPuff", 1) goto Ready })";

std::shared_ptr<const ActorCatalog> catalog_with(const std::string& decorate) {
  auto own = std::make_shared<ActorCatalog>();
  std::vector<std::string> warnings;
  EXPECT_TRUE(parse_decorate(decorate, "test", own.get(), &warnings));
  EXPECT_TRUE(warnings.empty()) << warnings.front();
  return own;
}

// Probe: ALTATTACK without its ammunition, of the only weapon: ATTACK_READY is 0 for 31 tics; ATTACK without its own, but with
// AltFire's: it stays up.
TEST(VizdoomRules, AnEmptyAltFireTakesTheWeaponDownAndUpAgain) {
  const auto own = catalog_with(std::string(R"(actor TwoBarrels : Weapon 20400 { Weapon.AmmoType "Clip"
      Weapon.AmmoUse 1 Weapon.AmmoType2 "Cell" Weapon.AmmoUse2 3 States {)") +
                                kWeaponStates + "}");
  for (const bool alternately : {true, false}) {
    World world(plain_room().build(), own);
    reset_world(world, {});
    const auto type = [&](std::string_view name) { return own->find(name).value(); };
    for (const char* const name : {"Pistol", "Fist", "Clip"}) take_item(world, 0, type(name), 0);
    give_item(world, 0, type("TwoBarrels"), 1);
    give_item(world, 0, type(alternately ? "Clip" : "Cell"), 10);
    for (int tic = 0; tic < 60; ++tic) run_tic(world, {});
    ASSERT_TRUE(world.player(0).weapon_ready);
    Buttons keys;
    (alternately ? keys.alt_attack : keys.attack) = true;
    run_tic(world, {&keys, 1});
    int down = 0;
    for (int tic = 0; tic < 60; ++tic, run_tic(world, {})) down += !world.player(0).weapon_ready;
    EXPECT_EQ(down > 25, alternately) << down;
  }
}

// Probe: GiveInventory("Shotgun", 1) with -deathmatch: 20 shells.
TEST(VizdoomRules, AWeaponOfADeathmatchBringsMoreAmmunition) {
  for (const bool deathmatch : {false, true}) {
    Game game(plain_room().build(), {.deathmatch = deathmatch});
    give_item(game.world, 0, game.world.catalog().find("Shotgun").value(), 1);
    EXPECT_EQ(count_item(game.world, 0, game.world.catalog().find("Shell").value()), deathmatch ? 20 : 8);
  }
}

// Probe: Sector_SetFriction of a part of the room that only the player's box reaches: it slides as in it. Where the floor of
// that part lies lower, it does not.
TEST(VizdoomRules, GroundThatTheBoxTouchesSlowsOrSlides) {
  for (const int step : {0, -8}) {
    Game game(cliff(step, 256, 505));
    Sector& ice = game.world.state().sectors[1];
    ice.special_friction = game.world.state().has_special_friction = true;
    ice.friction = 0xF000;
    game.body().velocity_y = to_fixed(4);
    game.tic();
    EXPECT_EQ(game.body().velocity_y, fixed_mul(to_fixed(4), step == 0 ? 0xF000 : 0xE800)) << step;
  }
}

// Probe: SetAirControl(1.0), then 7.25 units a tic in the air: 6.5706, 5.9549, ...; a thing keeps its 7.25.
TEST(VizdoomRules, AirControlSlowsPlayersInTheAir) {
  Game game(plain_room().build());
  game.world.state().air_control = kFracUnit;
  set_position(game.world, game.body().id, to_fixed(200), 0, to_fixed(100));
  game.body().velocity_x = 475136;
  game.tic();
  EXPECT_EQ(game.body().velocity_x, 430613);
}

// Probe: VIEW_HEIGHT with APROP_Speed 0.5 and 2.0: the same as with 1.0.
TEST(VizdoomRules, TheBobDoesNotShowTheSpeedOfAScript) {
  Game slow(plain_room().build()), plain(plain_room().build());
  slow.body().speed = kFracUnit / 2;
  Buttons keys;
  keys.forward = true;
  for (int tic = 0; tic < 5; ++tic) slow.tic(keys), plain.tic(keys);
  EXPECT_LT(slow.body().velocity_x, plain.body().velocity_x);
  EXPECT_EQ(slow.world.player(0).bob, plain.world.player(0).bob);
}

// Probe: a custom item in the way, 60 units ahead: what of Pickup lets it be taken.
TEST(VizdoomRules, WhatMakesACustomItemsPickup) {
  const std::vector<std::pair<std::string, bool>> pickups = {
      {"A_GiveInventory(\"Cell\", 30) fail", false},
      {"A_GiveInventory(\"Cell\", 30) stop", true},
      {"A_GiveInventory(\"Stimpack\", 1) stop", false},
      {"A_TakeInventory(\"Cell\", 3) stop", false},
      {"HealThing(5) stop", true},
      {"Floor_RaiseByValue(77, 8, 8) stop", false},
      {"A_CallSpecial(248, 5) stop", true},
      {"A_JumpIfHealthLower(1, \"Spawn\") stop", false},
      {"A_Log(\"x\") stop", false}};
  for (const auto& [pickup, taken] : pickups) {
    const auto own =
        catalog_with("actor C : CustomInventory 20202 { States { Spawn: TNT1 A -1 stop Pickup: TNT1 A 0 " +
                     pickup + " } }");
    test::LevelBuilder room = plain_room();
    room.thing(20202, 128, 0, 0, 5);
    World world(room.build(), own);
    reset_world(world, {});
    world.body_of(0)->velocity_x = to_fixed(1);
    run_tic(world, {});
    EXPECT_EQ(world.find_thing(5) == nullptr, taken) << pickup;
  }
}

// Probe: A_ChangeFlag("NOGRAVITY", 1) in a state of a thing that falls: it stays where it is.
TEST(VizdoomRules, AChangedFlagCounts) {
  const auto own = catalog_with(
      "actor F 20202 { States { Spawn: TNT1 A 1\n TNT1 A 1 A_ChangeFlag(\"NOGRAVITY\", 1)\n TNT1 A -1\n stop "
      "} }");
  test::LevelBuilder room = plain_room();
  room.thing(20202, 400, 0, 0, 5);
  World world(room.build(), own);
  reset_world(world, {});
  run_tic(world, {}), run_tic(world, {});
  EXPECT_TRUE(world.find_thing(5)->has(ActorFlag::kNoGravity));
}

// Probe: a step of 24, then a teleport: the eye continues rising from where it is.
TEST(VizdoomRules, ATeleportLeavesTheEyeItsWay) {
  test::LevelBuilder room = plain_room();
  room.thing(14, 600, 0, 0, 90);
  Game game(room.build());
  Player& player = game.world.state().players[0];
  player.view_height = to_fixed(27), player.view_height_delta = to_fixed(3);
  const SpecialCall call{.number = 70, .args = {90, 0, 0, 0, 0}, .activator = &game.body()};
  EXPECT_NE(game.world.events().run_special(game.world, call), 0);
  game.tic();
  EXPECT_EQ(player.view_height, to_fixed(30));
}

// Probe: a jump, a teleport that ends it, the key held: in the air again after the 18 tics of standing still.
TEST(VizdoomRules, AJumpIsForgottenWhileATeleportHoldsThePlayer) {
  Game game(plain_room().build());
  game.tic();
  game.world.state().players[0].jump_tics = -1;
  game.body().reaction_tics = 18;
  EXPECT_EQ(game.tics_to_jump(40), 19);
}

// Probe: sectors of the map with damageamount 49, 50 and 120: every 32 tics, or as damageinterval describes. Sector_SetDamage of 50 and
// more: every tic.
TEST(VizdoomRules, ASectorOfTheMapHurtsAtItsInterval) {
  for (const int32_t interval : {kDamageIntervalTics, 0}) {
    Game game(plain_room().build());
    Sector& sector = game.world.state().sectors[0];
    sector.damage_amount = 60, sector.damage_interval = interval;
    game.tic();
    game.body().health = game.world.state().players[0].health = 1000;
    for (int tic = 0; tic < 3; ++tic) game.tic();
    EXPECT_EQ(game.body().health, interval > 0 ? 1000 : 1000 - 3 * 60);
  }
}

// Probe: APROP_ReactionTime on skill 5: 8 of a barrel and a medikit, 0 of an imp.
TEST(VizdoomRules, OnlyMonstersReactAtOnceInNightmare) {
  test::LevelBuilder room = plain_room();
  room.thing(2012, 400, 0, 0, 5).thing(3001, 600, 0, 0, 6);
  Game game(room.build(), {.skill = 5});
  EXPECT_EQ(game.world.find_thing(5)->reaction_tics, 8);
  EXPECT_EQ(game.world.find_thing(6)->reaction_tics, 0);
}

// Probe: SpawnForced of a shotgun: CheckFlag DROPPED is 1, it brings 8 shells. Of a soul sphere: LEVELINFO_TOTAL_ITEMS is 1 more.
TEST(VizdoomRules, AnItemOfAScriptIsDroppedAndCounts) {
  Game game(plain_room().build());
  const auto type = [&](std::string_view name) { return game.world.catalog().find(name).value(); };
  const uint32_t gun = spawn_actor(game.world, type("Shotgun"), game.body().x, 0, 0, 0, 5).value();
  EXPECT_TRUE(game.world.actor(gun)->has(ActorFlag::kDropped));
  ASSERT_TRUE(touch_item(game.world, game.body(), *game.world.actor(gun)));
  EXPECT_EQ(count_item(game.world, 0, type("Shell")), 8);
  const int32_t items = game.world.state().item_total;
  ASSERT_TRUE(spawn_actor(game.world, type("Soulsphere"), to_fixed(400), 0, 0, 0, 6));
  EXPECT_EQ(game.world.state().item_total, items + 1);
}

// Probe: things and eyes between a floor and a ceiling that are too near: the thing hangs, the eye is 4 above the floor.
TEST(VizdoomRules, BetweenFloorAndCeilingThingsHangAndEyesStayAbove) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256), shut = builder.sector(16, 16);
  builder.room(room, 0, -256, 1024, 256)
      .island(shut, room, 512, -240, 1008, 240)
      .thing(1, 128, 0)
      .thing(2012, 700, 0, 0, 5);
  Game game(builder.build());
  Actor& kit = *game.world.find_thing(5);
  kit.z = to_fixed(17);
  for (int tic = 0; tic < 3; ++tic) game.tic();
  EXPECT_EQ(kit.z, to_fixed(16) - kit.height);
  set_position(game.world, game.body().id, to_fixed(700), 0, to_fixed(16));
  game.tic(), game.tic();
  EXPECT_GE(game.world.player(0).view_z, to_fixed(20));
}

// Probe: PowerSpeed, on the ground and in the air: half as much again.
TEST(VizdoomRules, PowerSpeedPushesHalfAsMuchAgain) {
  Game fast(plain_room().build()), plain(plain_room().build());
  give_item(fast.world, 0, fast.world.catalog().find("PowerSpeed").value(), 1);
  Buttons keys;
  keys.forward = true;
  fast.tic(keys), plain.tic(keys);
  EXPECT_EQ(fast.body().velocity_x / 3, plain.body().velocity_x / 2);
}

// Probe: Teleport onto a barrel: it dies, HITCOUNT and DAMAGECOUNT stay 0.
TEST(VizdoomRules, ATelefragIsNoHit) {
  test::LevelBuilder room = plain_room();
  room.thing(14, 600, 0, 0, 90).thing(2035, 610, 0, 0, 5);
  Game game(room.build());
  const SpecialCall call{.number = 70, .args = {90, 0, 0, 0, 0}, .activator = &game.body()};
  EXPECT_NE(game.world.events().run_special(game.world, call), 0);
  EXPECT_LT(game.world.find_thing(5)->health, 0);
  EXPECT_EQ(game.world.player(0).hits_dealt, 0);
}

// Probe: Scroll_Floor(1, -25, 33, 1) of a script: a thing on that floor moves with -4 350 and 5 742 after its first tic.
// Probe: a friend that dies, also one that is dead when the map begins: KILLCOUNT stays 0.
TEST(VizdoomRules, AFriendsDeathIsNoKill) {
  for (const bool is_friend : {false, true}) {
    test::LevelBuilder room = plain_room();
    MapThing thing;
    if (is_friend) thing.flags = kThingFriend;
    room.thing(3005, 600, 0, 0, 5, thing);
    Game game(room.build());
    damage_actor(game.world, *game.world.find_thing(5), nullptr, nullptr, 1000);
    EXPECT_EQ(game.world.state().kill_total, is_friend ? 0 : 1);
  }
}

// Probe: things with translucent beside alpha = 0.5 and invisible: APROP_Alpha is a quarter, APROP_RenderStyle translucent.
TEST(VizdoomRules, TranslucentGoesBeforeAlphaAndInvisible) {
  test::LevelBuilder room = plain_room();
  MapThing thing;
  thing.flags = kThingShadow | kThingInvisible, thing.alpha = 0.5f;
  room.thing(2011, 600, 0, 0, 5, thing);
  Game game(room.build());
  EXPECT_EQ(game.world.find_thing(5)->alpha, 0.25f);
  EXPECT_EQ(game.world.find_thing(5)->render_style, RenderStyle::kTranslucent);
}

// Probe: Thing_Damage of each amount: DAMAGE_TAKEN and HITS_TAKEN.
TEST(VizdoomRules, NoDamageAboveAThousandIsCounted) {
  for (const auto& [amount, counted] :
       {std::pair{999, 999}, {1000, 1000}, {1001, 0}, {5000, 0}, {2'000'000, 0}}) {
    Game game(plain_room().build());
    damage_actor(game.world, game.body(), nullptr, nullptr, amount);
    EXPECT_EQ(game.world.player(0).damage_taken, counted);
    EXPECT_EQ(game.world.player(0).hits_taken, counted > 0 ? 1 : 0);
    EXPECT_EQ(game.body().health, 100 - amount);
  }
}

// Probe: armour is used up by what kills at once, and saves nothing, sector type 115 included.
TEST(VizdoomRules, ArmourSavesNothingFromATelefrag) {
  for (const bool by_sector : {false, true}) {
    Game game(plain_room().build());
    give_item(game.world, 0, game.world.catalog().find("GreenArmor").value(), 1);
    damage_actor(game.world, game.body(), nullptr, nullptr, kTelefragDamage,
                 by_sector ? DamageType::kInstantDeath : DamageType::kNormal);
    EXPECT_EQ(game.body().health, 100 - kTelefragDamage);
    EXPECT_EQ(game.world.player(0).armor, 0) << by_sector;
  }
}

// Probe: an invulnerable player and damage of 5 000; of a million.
TEST(VizdoomRules, InvulnerabilityHoldsBelowATelefrag) {
  Game game(plain_room().build());
  game.world.state().players[0].powers.push_back({PowerKind::kInvulnerable, kNoType, 100});
  EXPECT_EQ(damage_actor(game.world, game.body(), nullptr, nullptr, 5000), 0);
  EXPECT_GT(damage_actor(game.world, game.body(), nullptr, nullptr, kTelefragDamage), 0);
}

// Probe: the barrel's corpse, 10.5 high, is stepped on until it is gone; one of 25 stops a player.
TEST(VizdoomRules, TheDyingBlockUntilTheyFall) {
  for (const int height : {25, 24}) {
    test::LevelBuilder room = plain_room();
    room.thing(3003, 200, 0, 180, 5);
    Game game(room.build());
    Actor& baron = *game.world.find_thing(5);
    damage_actor(game.world, baron, nullptr, nullptr, 2000);
    baron.height = to_fixed(height), baron.tics = -1;
    Buttons walk;
    walk.forward = true;
    for (int tic = 0; tic < 60; ++tic) game.tic(walk);
    EXPECT_EQ(game.body().x > to_fixed(200), height == 24);
  }
}

// Probe: TakeInventory of the fist and the pistol: ATTACK_READY falls a tic after the pistol is gone.
TEST(VizdoomRules, TheLastWeaponsReadinessOutlivesItByTheTic) {
  for (const bool is_last : {false, true}) {
    Game game(plain_room().build());
    for (int tic = 0; tic < 30; ++tic) game.tic();
    ASSERT_TRUE(game.world.player(0).weapon_ready);
    if (is_last) take_item(game.world, 0, game.world.catalog().find("Fist").value(), 0);
    take_item(game.world, 0, game.world.catalog().find("Pistol").value(), 0);
    EXPECT_EQ(game.world.player(0).weapon_ready, is_last);
    game.tic();
    EXPECT_FALSE(game.world.player(0).weapon_ready);
  }
}

// Probe: a CustomBridge with each arguments: where a walker's feet rise, and how high.
TEST(VizdoomRules, ArgumentsSizeABridgeAndDecoratesOwnCountBefore) {
  const auto own = catalog_with(
      "actor Own : CustomBridge 20001 { Args 40, 10 } actor Plain : CustomBridge 20002 { Radius 50 }");
  const auto made = [&](int number, std::array<int32_t, 5> args) {
    test::LevelBuilder room = plain_room();
    MapThing thing;
    thing.args = args, thing.special = 72;
    room.thing(number, 600, 0, 0, 5, thing);
    World world(room.build(), own);
    reset_world(world, {});
    return *world.find_thing(5);
  };
  for (const auto& [number, arg0, arg1, radius, height] :
       {std::array{20001, 0, 0, 40, 10}, std::array{20001, 60, 20, 40, 10}, std::array{20002, 60, 20, 60, 20},
        std::array{20002, 0, 0, 32, 4}, std::array{9991, 0, 0, 32, 4}, std::array{9990, 50, 0, 50, 4},
        std::array{118, 60, 20, 36, 4}, std::array{5065, 0, 0, 8, 8}}) {
    const Actor bridge = made(number, {arg0, arg1, 0, 0, 0});
    EXPECT_EQ(bridge.radius, to_fixed(radius)) << number;
    EXPECT_EQ(bridge.height, to_fixed(height)) << number;
    EXPECT_EQ(bridge.special, number == 20001 ? 0 : 72) << number;
  }
}

// Probe: crouching on an item that a teleport put below the player.
TEST(VizdoomRules, WhoDucksTakesWhatLiesThere) {
  test::LevelBuilder room = plain_room();
  room.thing(2014, 128, 0, 0, 5);
  Game game(room.build(), {.allow_crouch = true});
  game.tic();
  EXPECT_NE(game.world.find_thing(5), nullptr) << "nothing moved";
  Buttons crouch;
  crouch.crouch = true;
  game.tic(crouch);
  EXPECT_EQ(game.world.find_thing(5), nullptr);
}

// Probe: a rocket, and a walk, over a line with anycross, and with missilecross.
TEST(VizdoomRules, NoMissileIsAnybodyWhoCrosses) {
  for (const uint32_t flag : {kLineAnyCross, kLineMissileCross})
    for (const bool missile : {false, true}) {
      test::LevelBuilder room;
      const uint32_t hall = room.sector(0, 256), strip = room.sector(0, 256);
      room.room(hall, 0, -256, 1024, 256).island(strip, hall, 256, -200, 512, 200).thing(1, 128, 0);
      room.line(4).special = 243, room.line(4).flags |= flag;
      Game game(room.build());
      Buttons walk;
      walk.forward = walk.speed = true;
      if (missile)
        spawn_player_missile(game.world, game.body(), game.world.catalog().find("Rocket").value(), 0, 0, 0,
                             0);
      for (int tic = 0; tic < 40 && !game.world.level_exited(); ++tic) game.tic(missile ? Buttons() : walk);
      EXPECT_EQ(game.world.level_exited(), missile == (flag == kLineMissileCross));
    }
}

// Probe: a step at x = 256 and, at its corner, a line along the way with playerpush: the box would have lain on both.
TEST(VizdoomRules, WhoIsStoppedPushesAllLinesThatItsBoxWouldTouch) {
  test::LevelBuilder room;
  const uint32_t hall = room.sector(0, 256), block = room.sector(72, 256);
  room.room(hall, 0, -256, 1024, 256).island(block, hall, 256, 8, 512, 200).thing(1, 128, 0);
  room.line(7).special = 243, room.line(7).flags |= kLinePlayerPush;
  Game game(room.build());
  Buttons walk;
  walk.forward = true;
  for (int tic = 0; tic < 60 && !game.world.level_exited(); ++tic) game.tic(walk);
  EXPECT_TRUE(game.world.level_exited());
}

// Probe: things on the four sides of a square island of 72: those on its west and south sides stand below it.
TEST(VizdoomRules, APointOnALineLiesWestOrSouthOfIt) {
  test::LevelBuilder room;
  const uint32_t hall = room.sector(0, 256), high = room.sector(72, 256);
  room.room(hall, 0, -512, 1024, 512).island(high, hall, 400, -100, 600, 100);
  const auto level = room.build();
  const auto at = [&](int x, int y) { return level->index->sectors.sector_at(to_fixed(x), to_fixed(y)); };
  EXPECT_EQ(at(400, 0), hall);
  EXPECT_EQ(at(500, -100), hall);
  EXPECT_EQ(at(600, 0), high);
  EXPECT_EQ(at(500, 100), high);
}

// Probe: pistol in hand, fist and shotgun beside it; the two keys in each order.
TEST(VizdoomRules, ACycleKeyCountsWhileTheOtherIsUp) {
  struct Case {
    int next_from, next_to, previous_from, previous_to, slot;
  };
  for (const auto& [next_from, next_to, previous_from, previous_to, slot] :
       {Case{30, 31, 99, 99, 3}, Case{99, 99, 30, 31, 1}, Case{30, 31, 30, 31, 1}, Case{30, 60, 33, 34, 3},
        Case{33, 34, 30, 60, 1}}) {
    Game game(plain_room().build());
    give_item(game.world, 0, game.world.catalog().find("Shotgun").value(), 1);
    game.world.state().players[0].pending_weapon = kNoType;
    for (int tic = 0; tic < 80; ++tic) {
      Buttons keys;
      keys.select_next_weapon = tic >= next_from && tic < next_to;
      keys.select_previous_weapon = tic >= previous_from && tic < previous_to;
      game.tic(keys);
    }
    EXPECT_EQ(game.world.catalog()[game.world.player(0).ready_weapon].name, slot == 3 ? "Shotgun" : "Fist");
  }
}

// Probe: SetPlayerProperty(0, 1, PROP_INSTANTWEAPONSWITCH): the fist is ready in the tic that requests it.
TEST(VizdoomRules, WeaponsMayChangeAtOnce) {
  Game game(plain_room().build());
  for (int tic = 0; tic < 30; ++tic) game.tic();
  game.world.events().run_special(game.world,
                                  {.number = 191, .args = {0, 1, 2, 0, 0}, .activator = &game.body()});
  select_weapon(game.world, 0, game.world.catalog().find("Fist").value());
  game.tic();
  EXPECT_EQ(game.world.catalog()[game.world.player(0).ready_weapon].name, "Fist");
  EXPECT_TRUE(game.world.player(0).weapon_ready);
}

TEST(VizdoomRules, AScriptsScrollFloorIsTagXYMode) {
  test::LevelBuilder room = plain_room();
  room.thing(2011, 400, 0, 0, 5);
  Game game(room.build());
  game.world.state().sectors[0].tag = 1;
  const SpecialCall call{.number = Special::kScroll_Floor, .args = {1, -25, 33, 1, 0}, .activator = nullptr};
  EXPECT_NE(game.world.events().run_special(game.world, call), 0);
  game.tic();
  EXPECT_EQ(game.world.find_thing(5)->velocity_x, -4350);
  EXPECT_EQ(game.world.find_thing(5)->velocity_y, 5742);
}

// Probe: SetPlayerProperty(0, 1, PROP_FROZEN): the movement keys do nothing, JUMP lifts by 8 at once.
TEST(VizdoomRules, AFrozenPlayerJumps) {
  Game game(plain_room().build());
  game.world.state().players[0].frozen = true;
  Buttons keys;
  keys.jump = keys.forward = true;
  game.tic(keys);
  EXPECT_EQ(game.body().z, to_fixed(8));
  EXPECT_EQ(game.body().velocity_x, 0);
}

// Probe: a jump from a barrel while running: no friction in its first tic, though the barrel is still below.
TEST(VizdoomRules, AJumpFromABodyKeepsItsSpeed) {
  Game game(plain_room().thing(2035, 400, 0).build());
  ASSERT_NO_FATAL_FAILURE(stand_on_barrel(game));
  game.body().velocity_x = to_fixed(2), game.body().velocity_z = to_fixed(8);
  game.tic();
  EXPECT_EQ(game.body().velocity_x, to_fixed(2));
}

// Probe: VIEW_HEIGHT of a player who runs into a body at an angle: it bobs by what the keys gave along the body, all of it.
TEST(VizdoomRules, ABodyTakesOnlyTheBobThatLeadsIntoIt) {
  Game game(plain_room().thing(2035, 400, 0).build());
  set_position(game.world, game.body().id, to_fixed(372), 0, 0);
  game.body().velocity_x = to_fixed(8), game.body().velocity_y = to_fixed(3);
  Player& player = game.world.state().players[0];
  player.walk_x = to_fixed(8), player.walk_y = to_fixed(4);
  game.tic();
  EXPECT_EQ(game.body().velocity_x, 0);
  EXPECT_EQ(player.walk_x, 0);
  EXPECT_EQ(player.walk_y, fixed_mul(to_fixed(4), kGroundFriction));
}

// Probe: a fall of 11 a tic onto a body: VIEW_HEIGHT stays 41, and the jump key lifts at once.
TEST(VizdoomRules, AFallOntoABodyIsNoLanding) {
  Game game(plain_room().thing(2035, 400, 0).build());
  set_position(game.world, game.body().id, to_fixed(400), 0, to_fixed(120));
  for (int tic = 0; tic < 40 && game.body().z != to_fixed(42); ++tic) game.tic();
  ASSERT_EQ(game.body().z, to_fixed(42));
  EXPECT_EQ(game.world.player(0).view_height_delta, 0);
  EXPECT_EQ(game.tics_to_jump(20), 1);
}

// Probe: jumps past the edge of a body: at 40 and rising by 2 the eye does not stay behind at a top of 42, by 1 it does.
TEST(VizdoomRules, WhoRisesToTheTopOfABodyDoesNotStep) {
  for (const int rise : {1, 2}) {
    Game game(plain_room().thing(2035, 400, 0).build());
    set_position(game.world, game.body().id, to_fixed(372), 0, to_fixed(40));
    game.body().velocity_x = to_fixed(8), game.body().velocity_z = to_fixed(rise);
    game.tic();
    ASSERT_EQ(game.body().z, to_fixed(42));
    EXPECT_EQ(game.world.player(0).view_height, to_fixed(rise == 2 ? 41 : 39));
  }
}

// Probe: a crouched walk up a step of 8: VIEW_HEIGHT is 12.5, then 13.5: an eighth of what a crouched eye lacks.
TEST(VizdoomRules, ACrouchedEyeRisesByWhatItLacks) {
  Game game(cliff(8, 256, 480), {.player_count = 1, .allow_crouch = true});
  Buttons crouch;
  crouch.crouch = true;
  for (int tic = 0; tic < 25; ++tic) game.tic(crouch);
  game.body().velocity_x = to_fixed(20);
  game.tic(crouch);
  ASSERT_EQ(game.body().z, to_fixed(8));
  EXPECT_EQ(game.world.player(0).view_height_delta, kFracUnit);
}

// Probe: SetActorPosition to (504, 0, 10) beside a floor of 72 that sinks: 70 in that tic. A body with NOBLOCKMAP stays at 0.
TEST(VizdoomRules, ASinkingFloorLiftsWhatWasPutBelowIt) {
  test::LevelBuilder room;
  const uint32_t hall = room.sector(0, 256), high = room.sector(72, 256);
  room.room(hall, 0, -256, 1024, 256).island(high, hall, 512, -240, 1008, 240).thing(1, 128, 0);
  Game game(room.build());
  set_position(game.world, game.body().id, to_fixed(504), 0, to_fixed(10));
  const Actor& fog =
      game.world.spawn_unchecked(catalog()->find("TeleportFog").value(), to_fixed(504), to_fixed(100), 0);
  game.world.state().sectors[high].floor_height = to_fixed(70);
  settle_bodies(game.world, high, PlaneChange::kFloorDown, to_fixed(2), 0);
  EXPECT_EQ(game.body().z, to_fixed(70));
  EXPECT_EQ(fog.z, 0);
}

// Probe: A_FireCustomMissile with the pitch up: a missile with FLOORHUGGER flies with its whole speed along the floor, and up a
// step of 40.
TEST(VizdoomRules, AFloorHuggerKeepsToTheFloor) {
  const auto own = catalog_with(
      "actor Hugger 20100 { Projectile Speed 20 Radius 8 Height 8 Damage (0) +FLOORHUGGER\n States { Spawn: "
      "TNT1 A "
      "1 loop Death: TNT1 A -1 stop } }");
  World world(cliff(40, 256, 400), own);
  reset_world(world, {});
  world.body_of(0)->pitch = degrees_to_angle(-20);
  const Actor* missile =
      spawn_player_missile(world, *world.body_of(0), own->find("Hugger").value(), 0, 0, 0, 0);
  ASSERT_NE(missile, nullptr);
  const uint32_t id = missile->id;
  EXPECT_EQ(missile->velocity_x, to_fixed(20));
  EXPECT_EQ(missile->z, 0);
  for (int tic = 0; tic < 8; ++tic) run_tic(world, {});
  missile = world.find_actor(id);
  ASSERT_NE(missile, nullptr);
  EXPECT_EQ(missile->x, to_fixed(400 + 10 + 8 * 20));
  EXPECT_EQ(missile->z, to_fixed(40));
}

// Probe: SpawnForced of a missile: GetActorVelX is 1 (of 65536) after its first tic.
TEST(VizdoomRules, NoMissileStandsStill) {
  Game game(plain_room().build());
  const uint32_t type = catalog()->find("Rocket").value();
  const uint32_t id = game.world.spawn_unchecked(type, to_fixed(400), 0, to_fixed(50)).id;
  game.tic();
  EXPECT_EQ(game.world.find_actor(id)->velocity_x, 1);
}

// Probe: PROP_TOTALLYFROZEN in the air, and after the trigger: ON_GROUND is 1 after the fall, the next jump no later than without,
// the shot falls, MODINPUT_BUTTONS is 0 and INPUT_BUTTONS is not.
TEST(VizdoomRules, WhoIsTotallyFrozenGoesOnWithoutKeys) {
  Game game(plain_room().build());
  Player& player = game.world.state().players[0];
  const uint32_t clip = catalog()->find("Clip").value();
  for (int tic = 0; tic < 30; ++tic) game.tic();
  Buttons keys;
  keys.jump = keys.attack = true;
  game.tic(keys);
  player.totally_frozen = true;
  const int32_t clips = count_item(game.world, 0, clip);
  keys.forward = true;
  for (int tic = 0; tic < 40; ++tic) game.tic(keys);
  EXPECT_TRUE(player.on_ground);
  EXPECT_TRUE(player.weapon_ready);
  EXPECT_EQ(count_item(game.world, 0, clip), clips - 1);
  EXPECT_EQ(game.body().velocity_x, 0);
  constexpr int32_t kButtons = 1, kModifiedButtons = 9;
  EXPECT_NE(acs::player_input(game.world, 0, kButtons), 0);
  EXPECT_EQ(acs::player_input(game.world, 0, kModifiedButtons), 0);
  player.totally_frozen = false;
  EXPECT_EQ(game.tics_to_jump(20), 1);
}

// Probe: SetActorVelocity(0, -9, 3, 0, add, bob) while walking: without add the bob begins anew, whatever the last argument.
TEST(VizdoomRules, SetActorVelocityEndsTheBobUnlessItAdds) {
  for (const bool add : {false, true}) {
    acs::test::BehaviorBuilder code;
    code.script(1, static_cast<int>(acs::ScriptType::kEnter))
        .push({0, to_fixed(-9), to_fixed(3), 0, add, 0})
        .call(bytecode::BuiltIn::kSetActorVelocity, 6)
        .op(bytecode::PCode::kDrop)
        .end();
    const auto behavior = acs::Behavior::load(code.build(), "TEST");
    ASSERT_TRUE(behavior.has_value()) << behavior.error().message;
    World world(plain_room().build(), catalog(), *behavior);
    reset_world(world, {});
    Player& player = world.state().players[0];
    player.walk_x = to_fixed(5);
    run_tic(world, {});
    EXPECT_EQ(player.walk_x, add ? to_fixed(5) : 0);
  }
}

// Probe: TeleportOther of an item to where the player stands: it stays where it is.
TEST(VizdoomRules, NothingTeleportsOntoWhatCanBeShot) {
  constexpr int kTeleportOther = 76;
  for (const bool taken : {false, true}) {
    test::LevelBuilder room = plain_room();
    room.thing(2012, 200, 200, 0, 5).thing(14, taken ? 128 : 600, 0, 0, 90);
    Game game(room.build());
    game.world.events().run_special(game.world, {.number = kTeleportOther, .args = {5, 90, 0, 0, 0}});
    EXPECT_EQ(game.world.find_thing(5)->x, to_fixed(taken ? 200 : 600));
  }
}

// Probe: Spawn beside a shut door and beside an opening of 28: what is higher than the opening under its box does not fit.
TEST(VizdoomRules, NothingSpawnsHalfInWhatIsTooLow) {
  for (const auto& [ceiling, fits] : {std::pair(0, false), std::pair(15, false), std::pair(28, true)}) {
    test::LevelBuilder room;
    const uint32_t hall = room.sector(0, 256), low = room.sector(0, ceiling);
    room.room(hall, 0, -256, 1024, 256).island(low, hall, 512, -240, 1008, 240).thing(1, 128, 0);
    Game game(room.build());
    EXPECT_EQ(spawn_actor(game.world, catalog()->find("Stimpack").value(), to_fixed(504), 0, 0, 0, 0, false)
                  .has_value(),
              fits)
        << ceiling;
  }
}

// Probe: Spawn of a missile where a body with SHOOTABLE and without SOLID stands: nothing appears.
TEST(VizdoomRules, NoMissileSpawnsInWhatCanBeShot) {
  Game game(plain_room().thing(2035, 400, 0, 0, 5).build());
  game.world.find_thing(5)->set(ActorFlag::kSolid, false);
  const uint32_t rocket = catalog()->find("Rocket").value();
  EXPECT_FALSE(spawn_actor(game.world, rocket, to_fixed(400), 0, to_fixed(8), 0, 0, false));
  EXPECT_TRUE(spawn_actor(game.world, rocket, to_fixed(600), 0, to_fixed(8), 0, 0, false));
}

// Probe: Sector_SetFriction(99, 50), one tic of MOVE_FORWARD across a velocity of 0.99 and 1.01 times 15000, 30000 and 60000 of
// 65536: the push doubles at each of the three.
TEST(VizdoomRules, InMudTheFastPushBetter) {
  std::vector<Fixed> pushes;
  for (const Fixed speed : {14'850, 15'150, 29'700, 30'300, 59'400, 60'600}) {
    Game game(plain_room().build());
    Sector& mud = game.world.state().sectors[0];
    mud.special_friction = game.world.state().has_special_friction = true;
    mud.friction = 0xDC00, mud.move_factor = 64;
    Buttons keys;
    keys.forward = true;
    game.tic();
    game.body().velocity_y = speed;
    const Fixed before = game.body().x;
    game.tic(keys);
    pushes.push_back(game.body().x - before);
  }
  ASSERT_GT(pushes[0], 1000);
  const std::vector<int> factors = {1, 2, 2, 4, 4, 8};
  for (std::size_t i = 0; i < factors.size(); ++i) EXPECT_NEAR(pushes[i], factors[i] * pushes[0], 8) << i;
}

// Probe: lines with Teleport_NoFog(90, facing) crossed with a velocity of 6.4 at 270 degrees, destination at 50: facing 0 turns by
// the line's angle less the destination's plus 90, 1 to 3 face as the destination.
TEST(VizdoomRules, TeleportNoFogOfALineTurnsByTheLine) {
  for (const int facing : {0, 1, 2, 3}) {
    test::LevelBuilder room;
    const uint32_t hall = room.sector(0, 256), strip = room.sector(0, 256);
    room.room(hall, 0, -256, 1024, 256).island(strip, hall, 256, -200, 512, 200).thing(1, 300, 0, 270);
    room.thing(14, 800, 100, 50, 90);
    Game game(room.build());
    constexpr int kNorthLine = 5;  // from (256, 200) to (512, 200), east
    game.body().velocity_y = to_fixed(-6);
    const SpecialCall call{
        .number = 71, .args = {90, facing, 0, 0, 0}, .activator = &game.body(), .line = kNorthLine};
    EXPECT_NE(game.world.events().run_special(game.world, call), 0);
    const Angle expected =
        facing == 0 ? degrees_to_angle(270) - degrees_to_angle(50) + kAngle90 : degrees_to_angle(50);
    EXPECT_EQ(game.body().angle, expected) << facing;
    EXPECT_EQ(game.body().velocity_y != 0, facing == 0) << facing;
  }
}

// Probe: A_Explode(5, 64, 0) of a body that can be shot: the neighbour loses 2, itself nothing; without the 0 it loses 5.
TEST(VizdoomRules, ABlastThatSparesItsSourceSparesItsSpot) {
  for (const bool hurts : {false, true}) {
    Game game(plain_room().thing(2035, 400, 0, 0, 5).thing(2035, 440, 0, 0, 6).build());
    Actor& spot = *game.world.find_thing(5);
    const Actor& other = *game.world.find_thing(6);
    const int32_t health = spot.health;
    radius_attack(game.world, spot, nullptr, 5, to_fixed(64), DamageType::kNormal, hurts);
    EXPECT_EQ(spot.health, hurts ? health - 5 : health);
    EXPECT_LT(other.health, health);
  }
}

// Probe: sectors of special 71 (5 points), 256 + 69 (5 of the bits, 10 of the type), with damageamount 3, and after
// Sector_SetDamage of 20 and of 0: one hit every 32 tics, of the last in this order.
TEST(VizdoomRules, ASectorHurtsInOneWay) {
  struct Case {
    int special, of_map, of_script, expected;
  };
  constexpr int kSetDamage = 214, kNothing = -1;
  for (const auto& [special, of_map, of_script, expected] :
       {Case{71, 0, kNothing, 5}, Case{256 + 69, 0, kNothing, 5}, Case{512 + 71, 0, kNothing, 10},
        Case{256 + 75, 0, kNothing, 5}, Case{71, 3, kNothing, 3}, Case{71, 0, 20, 20}, Case{256, 0, 2, 2},
        Case{71, 0, 0, 0}}) {
    Game game(plain_room().build());
    game.tic();
    Sector& sector = game.world.state().sectors[0];
    sector.special = special, sector.damage_amount = of_map;
    if (of_script != kNothing)
      game.world.events().run_special(game.world, {.number = kSetDamage, .args = {1, of_script, 0, 0, 0}});
    for (int tic = 0; tic < 40; ++tic) game.tic();
    EXPECT_EQ(game.body().health, 100 - expected) << special << " " << of_map << " " << of_script;
    EXPECT_EQ(game.world.player(0).hits_taken, expected > 0 ? 1 : 0);
  }
}

// Probe: things on the sloped sides of an island of 72, its front without and within: they lie behind the line.
TEST(VizdoomRules, APointOnASlopedLineLiesBehindIt) {
  for (const bool faces_inside : {false, true}) {
    test::LevelBuilder room;
    const uint32_t hall = room.sector(0, 256), high = room.sector(72, 256);
    test::LevelBuilder::Points clockwise = {{400, 0}, {500, 100}, {600, 0}, {500, -100}};
    if (!faces_inside) std::reverse(clockwise.begin(), clockwise.end());
    room.room(hall, 0, -512, 1024, 512)
        .island(clockwise, faces_inside ? high : hall, faces_inside ? hall : high);
    const auto level = room.build();
    for (const auto& [x, y] :
         {std::pair(440, 40), std::pair(540, 60), std::pair(560, -40), std::pair(460, -60)})
      EXPECT_EQ(level->index->sectors.sector_at(to_fixed(x), to_fixed(y)), faces_inside ? hall : high);
  }
}

}  // namespace vizdoom_rules_test
}  // namespace comrad::doom
