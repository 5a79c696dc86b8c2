#include "sim_workers/oracle/navigator.h"

#include <gtest/gtest.h>

#include "sim_workers/engine/tic/tic.h"
#include "tests/support/level_builder.h"

namespace comrad::sim {
namespace navigator_test {

using doom::to_fixed;

std::unique_ptr<doom::World> play(const std::shared_ptr<const doom::Level>& level) {
  auto world = std::make_unique<doom::World>(level, std::make_shared<const doom::ActorCatalog>());
  reset_world(*world, {.player_count = 1});
  return world;
}

TEST(Navigator, WalksRoundAPillar) {
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.room(room, -512, -512, 512, 512).pillar(room, -64, -200, 64, 200).thing(1, -300, 0);
  const auto world = play(builder.build());
  Navigator navigator;
  navigator.refresh(*world);
  const auto length = navigator.way_length({-300, 0}, {300, 0});
  ASSERT_TRUE(length);
  EXPECT_GT(*length, 680);  // 600 as the crow flies; round a corner at (+-82, 218) it is 724
  EXPECT_LT(*length, 800);
  Place at{-300, 0};
  for (int step = 0; step < 200 && distance_between(at, {300, 0}) > 8; ++step) {
    const auto next = navigator.waypoint(at, {300, 0});
    ASSERT_TRUE(next);
    EXPECT_TRUE(navigator.is_open(*next));
    const double far = distance_between(at, *next), pace = std::min(far, 16.0);
    if (far > 0) at = {at.x + (next->x - at.x) * pace / far, at.y + (next->y - at.y) * pace / far};
    EXPECT_FALSE(std::abs(at.x) < 64 + 15 && std::abs(at.y) < 200 + 15) << at.x << " " << at.y;
  }
  EXPECT_LE(distance_between(at, {300, 0}), 8);
}

TEST(Navigator, FollowsADoorThatOpens) {
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128), door = builder.sector(0, 0);
  builder.room(room, -512, -512, 512, 512).island(door, room, -16, -500, 16, 500).thing(1, -300, 0);
  const auto world = play(builder.build());
  Navigator navigator;
  navigator.refresh(*world);
  EXPECT_FALSE(navigator.way_length({-300, 0}, {300, 0}));
  world->state().sectors[door].ceiling_height = to_fixed(128);
  navigator.refresh(*world);
  EXPECT_TRUE(navigator.way_length({-300, 0}, {300, 0}));
}

TEST(Navigator, TakesStepsUpTo24AndDropsAsDeepAsItIsSet) {
  for (const auto& [height, up, down] : {std::tuple{24, true, true}, {32, false, true}, {-24, true, true}}) {
    doom::test::LevelBuilder builder;
    const uint32_t room = builder.sector(0, 256), high = builder.sector(height, 256);
    builder.room(room, -512, -512, 512, 512).island(high, room, 0, -500, 500, 500).thing(1, -300, 0);
    const auto world = play(builder.build());
    Navigator navigator;
    navigator.refresh(*world);
    EXPECT_EQ(navigator.way_length({-300, 0}, {300, 0}).has_value(), up) << height;
    EXPECT_EQ(navigator.way_length({300, 0}, {-300, 0}).has_value(), down) << height;
  }
}

TEST(Navigator, KeepsOutOfSectorsToAvoid) {
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256), lava = builder.sector(0, 256, 7);
  builder.room(room, -512, -512, 512, 512).island(lava, room, -100, -400, 100, 500).thing(1, -300, 0);
  const auto world = play(builder.build());
  Navigator navigator({.sector_cost = [](const doom::World& w, uint32_t sector) {
    return w.level().sectors[sector].tag == 7 ? -1.0 : 0.0;
  }});
  navigator.refresh(*world);
  const auto length = navigator.way_length({-300, 300}, {300, 300});
  ASSERT_TRUE(length);
  EXPECT_GT(*length, 1300);
}

}  // namespace navigator_test
}  // namespace comrad::sim
