// Bodies against walls, corners, pillars, steps and each other.
#include <gtest/gtest.h>

#include <cmath>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/arena.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace collision_test {

const std::shared_ptr<const ActorCatalog>& catalog() {
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  return kCatalog;
}

World world_of(std::shared_ptr<const Level> level, int players = 1) {
  World world(std::move(level), catalog());
  reset_world(world, {.player_count = players});
  for (int player = 0; player < players; ++player)
    world.body_of(player)->reaction_tics = 0;  // no birth pause
  return world;
}

void tics(World& world, const Buttons& buttons, int count) {
  for (int i = 0; i < count; ++i) run_tic(world, {&buttons, 1});
}

Buttons running() {
  Buttons buttons;
  buttons.forward = buttons.speed = true;
  return buttons;
}

/// True where the body's box reaches through a line that stops it.
bool stuck_in_a_wall(const World& world, const Actor& body) {
  const Box box = Box::around(body.x, body.y, body.radius);
  bool stuck = false;
  world.level().index->blockmap.for_each_line(box, [&](const BlockLine& line) {
    stuck = stuck || ((line.back_sector < 0 || (line.flags & kLineBlocking) != 0) && line.crosses(box));
    return true;
  });
  return stuck;
}

TEST(Collision, ABodyNeverEntersAWallOrLeavesTheArena) {
  for (uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    World world = world_of(test::star_arena(seed), 2);
    Rng rng(seed);
    std::array<Buttons, 2> buttons;
    int wall_tics = 0;
    for (int tic = 0; tic < 4000; ++tic) {
      if (tic % 8 == 0)
        for (Buttons& player : buttons) {
          player = Buttons{};
          player.forward = rng.below(4) != 0;
          player.left = rng.below(3) == 0, player.right = rng.below(3) == 0;
          player.speed = rng.below(2) == 0;
          player.turn_left = rng.below(4) == 0, player.turn_right = rng.below(4) == 0;
        }
      run_tic(world, buttons);
      for (int player = 0; player < 2; ++player) {
        const Actor& body = world.body(player);
        ASSERT_FALSE(stuck_in_a_wall(world, body)) << "tic " << tic;
        ASSERT_LT(std::hypot(to_double(body.x), to_double(body.y)), 2000) << "tic " << tic;
        wall_tics += buttons[player].forward && body.velocity_x == 0 && body.velocity_y == 0;
      }
    }
  }
}

TEST(Collision, RunningIntoAWallStopsJustBeforeIt) {
  World world = world_of(test::one_room());
  tics(world, running(), 100);
  const Actor& body = world.body(0);
  EXPECT_LE(body.x, to_fixed(512 - 16));
  EXPECT_GT(body.x, to_fixed(512 - 17));
  EXPECT_EQ(body.y, 0);
  EXPECT_EQ(body.velocity_x, 0);
}

TEST(Collision, SlidingAlongAWallKeepsTheSpeedAlongIt) {
  World world = world_of(test::one_room());
  world.set_angle(world.player(0).actor_id, degrees_to_angle(20));
  tics(world, running(), 100);
  const Fixed x = world.body(0).x, y = world.body(0).y;
  tics(world, running(), 1);
  EXPECT_EQ(world.body(0).x, x) << "at the east wall";
  // Thrust along the wall is 1.5625 * sin 20; the gap before the wall costs 1/32 of every step on top of
  // friction, so the step settles at thrust / (1 / (1 - 1/32) - 0.90625) = 4.24.
  EXPECT_NEAR(to_double(world.body(0).y - y), 4.24, 0.1);
}

TEST(Collision, ASlantedWallTurnsTheMoveAlongItself) {
  test::LevelBuilder builder;
  const uint32_t sector = builder.sector(0, 128);
  builder.room(sector, {{-512, -512}, {-512, 512}, {512, 512}, {0, -512}}).thing(1, 0, 256);
  World world = world_of(builder.build());
  tics(world, running(), 60);
  // The east wall runs from (0, -512) to (512, 512): moving east along it means moving up.
  EXPECT_GT(world.body(0).y, to_fixed(300));
  EXPECT_FALSE(stuck_in_a_wall(world, world.body(0)));
}

TEST(Collision, AMeetingFractionRoundsToNearestAndHalvesToEven) {
  const Way wall{0, 0, 0, to_fixed(1)};
  // From x to the wall at 0, on a way of 2 * 65536 * 65536 steps: the fraction is -x / 131072.
  const auto fraction = [&](int64_t x) { return meeting_fraction({x, 0, int64_t{1} << 33, 0}, wall); };
  const std::pair<int64_t, int64_t> cases[] = {{-262144, 2}, {-327679, 2}, {-327680, 2}, {-327681, 3},
                                               {-458752, 4}, {65535, 0},   {65536, 0},   {65537, -1},
                                               {196608, -2}, {0, 0}};
  for (const auto& [x, expected] : cases) EXPECT_EQ(fraction(x), expected) << x;
  EXPECT_EQ(meeting_fraction({to_fixed(-8), 5, to_fixed(-32), 0}, wall), -kFracUnit / 4) << "leads away";
  EXPECT_EQ(meeting_fraction({to_fixed(-8), 5, 0, to_fixed(3)}, wall), 0) << "parallel";
}

TEST(Collision, AWayTurnsAlongAWallInRoundedFractions) {
  Way straight{to_fixed(3), to_fixed(-7), -300, 500};
  turn_along({0, 0, to_fixed(64), 0}, straight);
  EXPECT_EQ(straight.dx, -300);
  EXPECT_EQ(straight.dy, 0);

  Rng rng(uint64_t{7});
  int rounded = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto between = [&](int low, int high) { return low + static_cast<int>(rng.below(high - low + 1)); };
    const Way wall{to_fixed(between(-500, 500)), to_fixed(between(-500, 500)), to_fixed(between(100, 400)),
                   to_fixed(between(100, 400))};
    // A body 16 to 23 units in front of the middle of the wall, on its way into it.
    const double length = std::hypot(wall.dx, wall.dy), gap = to_fixed(between(16, 23));
    Way move{wall.x + wall.dx / 2 + std::llround(gap * wall.dy / length),
             wall.y + wall.dy / 2 - std::llround(gap * wall.dx / length), 0, 0};
    const double along = to_fixed(between(-10, 10)), into = to_fixed(between(1, 10));
    move.dx = std::llround((along * wall.dx - into * wall.dy) / length);
    move.dy = std::llround((along * wall.dy + into * wall.dx) / length);
    const double exact = (move.dx * wall.dx + move.dy * wall.dy) / length;
    turn_along(wall, move);
    const double turned = (move.dx * wall.dx + move.dy * wall.dy) / length;
    // Each of the two fractions of the wall is off by half a step at most, the third scales what lies between.
    const double off_max = length / kFracUnit * into / gap + std::abs(exact) / kFracUnit + 2;
    ASSERT_NEAR(turned, exact, off_max) << i;
    rounded += std::abs(turned - exact) > 2;
  }
  EXPECT_GT(rounded, 500) << "a projection that is exact is not the original engine's";
}

TEST(Collision, ABodyWhoseCentreLiesOnAWallIsNotThrownAlongIt) {
  for (const int64_t aside : {0, 1, 2, -1}) {
    Way move{to_fixed(100) + aside, to_fixed(100), to_fixed(-5), to_fixed(8)};
    turn_along({0, 0, to_fixed(20000), to_fixed(20000)}, move);
    EXPECT_LE(std::abs(move.dx), 2 * to_fixed(13)) << aside;
    EXPECT_LE(std::abs(move.dy), 2 * to_fixed(13)) << aside;
  }
}

TEST(Collision, AStripBehindALineCountsAsBeforeIt) {
  for (const int length : {16, 64, 256}) {
    BlockLine line;
    line.x2 = to_fixed(length);  // its front is in the south
    const Fixed strip = kFracUnit / length;
    EXPECT_FALSE(line.is_behind(to_fixed(8), to_fixed(-1)));
    EXPECT_FALSE(line.is_behind(to_fixed(8), 0));
    EXPECT_FALSE(line.is_behind(to_fixed(8), strip - 1)) << length;
    EXPECT_TRUE(line.is_behind(to_fixed(8), strip)) << length;
  }
}

TEST(Collision, ABodyMayReachOverASlantedLineByTheStripButNotOverAStraightOne) {
  const auto square = [](Fixed x, Fixed y) { return Box::around(x, y, to_fixed(16)); };
  BlockLine slanted;  // its front is in the south-east
  slanted.x2 = slanted.y2 = to_fixed(64);
  // The north-western corner reaches over the line by the number of fixed-point steps along each axis.
  const auto corner_over = [&](Fixed over) {
    return square(to_fixed(40) + 16 * kFracUnit - over, to_fixed(24));
  };
  EXPECT_FALSE(slanted.passes_through(corner_over(0)));
  EXPECT_TRUE(slanted.passes_through(corner_over(1)));
  EXPECT_FALSE(slanted.crosses(corner_over(1)));
  EXPECT_FALSE(slanted.crosses(corner_over(kFracUnit / 64 - 1)));
  EXPECT_TRUE(slanted.crosses(corner_over(kFracUnit / 64)));

  BlockLine straight;
  straight.x2 = to_fixed(64);
  EXPECT_FALSE(straight.crosses(square(to_fixed(32), to_fixed(-16))));
  EXPECT_TRUE(straight.crosses(square(to_fixed(32), to_fixed(-16) + 1)));
}

TEST(Collision, ABodyPassesTheEndOfASlantedWallThatItOnlyTouches) {
  for (const int inside : {0, 1}) {
    test::LevelBuilder builder;
    const uint32_t sector = builder.sector(0, 128);
    builder.room(sector, -512, -512, 512, 512);
    // The player runs north; the pillar's western corner lies at the edge of its box, or one unit inside.
    const int corner = 16 - inside;
    builder.room(sector, {{corner, 0}, {corner + 60, -30}, {corner + 60, 30}}).thing(1, 0, -200);
    World world = world_of(builder.build());
    world.set_angle(world.player(0).actor_id, kAngle90);
    tics(world, running(), 30);
    EXPECT_EQ(world.body(0).x == 0, inside == 0);
  }
}

TEST(Collision, ACornerHoldsTheBodyWithoutThrowingIt) {
  World world = world_of(test::one_room());
  world.set_angle(world.player(0).actor_id, degrees_to_angle(40));
  tics(world, running(), 300);
  const Actor& body = world.body(0);
  EXPECT_LE(body.x, to_fixed(496));
  EXPECT_LE(body.y, to_fixed(496));
  EXPECT_GT(body.x, to_fixed(490));
  EXPECT_GT(body.y, to_fixed(490));
}

TEST(Collision, ThePointOfAPillarBetweenTheBodysCornersStopsIt) {
  test::LevelBuilder builder;
  const uint32_t sector = builder.sector(0, 128);
  builder.room(sector, -512, -512, 512, 512).pillar(sector, 100, -4, 140, 4).thing(1, -100, 0);
  World world = world_of(builder.build());
  tics(world, running(), 100);
  EXPECT_LE(world.body(0).x, to_fixed(84));
}

TEST(Collision, StepsOf24AreClimbedAndStepsOf25AreWalls) {
  for (const int height : {24, 25}) {
    test::LevelBuilder builder;
    const uint32_t low = builder.sector(0, 256), high = builder.sector(height, 256);
    builder.room(low, -512, -512, 512, 512).island(high, low, 0, -256, 400, 256).thing(1, -200, 0);
    World world = world_of(builder.build());
    tics(world, running(), 24);
    if (height == 24) {
      EXPECT_EQ(world.body(0).z, to_fixed(24));
      EXPECT_GT(world.body(0).x, 0);
      EXPECT_LT(world.player(0).view_z, to_fixed(24 + 41)) << "the eye still catches up";
    } else {
      EXPECT_EQ(world.body(0).z, 0);
      EXPECT_LE(world.body(0).x, to_fixed(-16));
    }
  }
}

TEST(Collision, APlayerWalksOffALedgeAndFalls) {
  test::LevelBuilder builder;
  const uint32_t low = builder.sector(0, 512), high = builder.sector(200, 512);
  builder.room(low, -512, -512, 512, 512).island(high, low, -256, -256, 0, 256).thing(1, -64, 0);
  World world = world_of(builder.build());
  EXPECT_EQ(world.body(0).z, to_fixed(200));
  bool in_air = false;
  for (int tic = 0; tic < 60; ++tic) {
    tics(world, running(), 1);
    in_air = in_air || (world.body(0).z < to_fixed(200) && world.body(0).z > 0);
  }
  EXPECT_TRUE(in_air);
  EXPECT_EQ(world.body(0).z, 0);
  EXPECT_EQ(world.player(0).health, 100) << "falling does not hurt";
}

TEST(Collision, GravityCountsTwiceInTheTicThatLeavesALedgeAndOnceForAJump) {
  test::LevelBuilder builder;
  const uint32_t low = builder.sector(0, 512), high = builder.sector(200, 512);
  builder.room(low, -512, -512, 512, 512).island(high, low, -256, -256, 0, 256).thing(1, -64, 0);
  for (const bool jumps : {false, true}) {
    World world = world_of(builder.build());
    std::vector<int> velocities;  // of each tic in the air, in whole units
    for (int tic = 0; tic < 60 && velocities.size() < 24; ++tic) {
      Buttons buttons = running();
      buttons.jump = jumps && world.body(0).x > to_fixed(-24);
      tics(world, buttons, 1);
      if (world.body(0).velocity_z != 0) velocities.push_back(world.body(0).velocity_z >> kFracBits);
    }
    ASSERT_GE(velocities.size(), 4u);
    // As in ViZDoom (lava_pit and platform_chain of tests/parity/scenario_parity.py).
    const int first = jumps ? 7 : -2;
    for (int tic = 0; tic < 4; ++tic)
      EXPECT_EQ(velocities[static_cast<std::size_t>(tic)], first - tic) << jumps;
  }
}

TEST(Collision, LowCeilingsAndBlockingLinesStop) {
  for (const bool low_ceiling : {true, false}) {
    test::LevelBuilder builder;
    const uint32_t room = builder.sector(0, 128), door = builder.sector(0, low_ceiling ? 55 : 128);
    builder.room(room, -512, -512, 512, 512);
    builder.island(door, room, 0, -256, 64, 256, low_ceiling ? 0u : uint32_t{kLineBlocking})
        .thing(1, -200, 0);
    World world = world_of(builder.build());
    tics(world, running(), 60);
    EXPECT_LE(world.body(0).x, to_fixed(-16));
  }
}

TEST(Collision, PlayersAreSolidToEachOther) {
  World world = world_of(test::one_room(), 2);
  std::array<Buttons, 2> buttons;
  buttons[0] = running();
  for (int tic = 0; tic < 200; ++tic) {
    run_tic(world, buttons);
    const Actor &first = world.body(0), &second = world.body(1);
    ASSERT_TRUE(std::abs(first.x - second.x) >= to_fixed(32) || std::abs(first.y - second.y) >= to_fixed(32));
  }
  EXPECT_EQ(world.body(1).x, to_fixed(128)) << "the one that stands is not pushed";
}

TEST(Collision, ABodySlidesPastAnotherOne) {
  World world = world_of(test::one_room(), 2);
  set_position(world, world.player(1).actor_id, to_fixed(128), to_fixed(20), 0);
  world.set_angle(world.player(0).actor_id, degrees_to_angle(-20));
  std::array<Buttons, 2> buttons;
  buttons[0] = running();
  for (int tic = 0; tic < 60; ++tic) run_tic(world, buttons);
  EXPECT_GT(world.body(0).x, to_fixed(200));
}

TEST(Collision, BodiesThatOverlapComeApart) {
  World world = world_of(test::one_room(), 2);
  set_position(world, world.player(1).actor_id, world.body(0).x + to_fixed(4), world.body(0).y, 0);
  std::array<Buttons, 2> buttons;
  buttons[1].backward = true;  // faces west, so backs away to the east
  for (int tic = 0; tic < 30; ++tic) run_tic(world, buttons);
  EXPECT_GT(world.body(1).x - world.body(0).x, to_fixed(32));
}

TEST(Collision, APlayerStandsOnASolidThingAndFallsWhenItGoes) {
  World world = world_of(test::one_room());
  const uint32_t pillar =
      spawn_actor(world, catalog()->find("ShortGreenColumn").value(), 0, to_fixed(200), 0, 0).value();
  set_position(world, world.player(0).actor_id, 0, to_fixed(200), to_fixed(100));
  const Buttons nothing;
  tics(world, nothing, 40);
  EXPECT_EQ(world.body(0).z, to_fixed(40));
  world.remove(pillar);
  tics(world, nothing, 40);
  EXPECT_EQ(world.body(0).z, 0);
}

TEST(Collision, TeleportsOnlyWhereTheBodyFits) {
  World world = world_of(test::one_room(), 2);
  const uint32_t body = world.player(0).actor_id;
  const Actor before = world.body(0);
  EXPECT_FALSE(try_teleport(world, body, to_fixed(500), 0)) << "in the wall";
  EXPECT_FALSE(try_teleport(world, body, world.body(1).x + to_fixed(31), 0)) << "in the other player";
  EXPECT_EQ(world.body(0).x, before.x);
  EXPECT_TRUE(try_teleport(world, body, world.body(1).x - to_fixed(32), 0));
  EXPECT_TRUE(try_teleport(world, body, to_fixed(-300), to_fixed(300)));
  EXPECT_EQ(world.body(0).y, to_fixed(300));
}

TEST(Collision, NothingTeleportsOrSpawnsIntoTheVoid) {
  test::LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 128);
  builder.room(hall, -512, -512, 512, 512).pillar(hall, 128, 128, 384, 384).thing(1, 0, 0);
  World world = world_of(builder.build());
  const uint32_t body = world.player(0).actor_id;
  const uint32_t medikit = catalog()->find("Medikit").value();
  EXPECT_FALSE(try_teleport(world, body, to_fixed(256), to_fixed(256)))
      << "deep inside the pillar, no line touched";
  EXPECT_FALSE(try_teleport(world, body, to_fixed(2000), 0)) << "outside the map";
  EXPECT_FALSE(spawn_actor(world, medikit, to_fixed(256), to_fixed(256), 0, 0));
  EXPECT_TRUE(try_teleport(world, body, to_fixed(64), to_fixed(256)));
  EXPECT_TRUE(spawn_actor(world, medikit, to_fixed(450), to_fixed(256), 0, 0));
}

TEST(Collision, SpawnsOnlyWhereTheActorFits) {
  World world = world_of(test::one_room());
  const uint32_t column = catalog()->find("TallGreenColumn").value();
  const uint32_t medikit = catalog()->find("Medikit").value();
  EXPECT_FALSE(spawn_actor(world, column, to_fixed(500), 0, 0, 0)) << "in the wall";
  EXPECT_FALSE(spawn_actor(world, column, world.body(0).x, world.body(0).y, 0, 0)) << "in the player";
  EXPECT_FALSE(spawn_actor(world, medikit, to_fixed(500), 0, 0, 0)) << "items too need room";
  EXPECT_FALSE(spawn_actor(world, medikit, 0, 0, to_fixed(-1), 0)) << "below the floor";
  EXPECT_FALSE(spawn_actor(world, 9999, 0, 0, 0, 0));
  EXPECT_EQ(world.actors().size(), 1u);
  EXPECT_TRUE(spawn_actor(world, column, to_fixed(500), 0, 0, 0, 0, true)) << "forced";
  EXPECT_TRUE(spawn_actor(world, medikit, world.body(0).x, world.body(0).y, 0, 0)) << "items are not solid";
}

}  // namespace collision_test
}  // namespace comrad::doom
