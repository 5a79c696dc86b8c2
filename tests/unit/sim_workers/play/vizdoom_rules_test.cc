// Rules of movement and damage as ViZDoom 1.3.2 was measured to have them, one number after the other. Each probe was
// a map of the same shape, played tic by tic with the same keys.
#include <gtest/gtest.h>

#include <vector>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
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
TEST(VizdoomRules, SpawnAsksForTheFloorOfTheCentreToo) {
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

}  // namespace vizdoom_rules_test
}  // namespace comrad::doom
