#include "doomgen/layout/map_checks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doomgen/layout/map_plan.h"

namespace comrad::doomgen {
namespace map_checks_test {

using testing::HasSubstr;

MapPlan hall() {
  MapPlan plan;
  plan.add_area({.name = "hall"}, Box{{0, 0}, {512, 512}});
  return plan;
}

std::string words(const Status& status) { return status ? "" : status.error().message; }

TEST(MapChecks, StartsMustBeThereFreeAndApart) {
  MapPlan plan = hall();
  plan.add_start(1, {64, 64}, 0);
  EXPECT_EQ(words(check_starts(*plan.build(), 1)), "");
  EXPECT_THAT(words(check_starts(*plan.build(), 2)), HasSubstr("player 2 has no start"));
  MapPlan close = plan;
  close.add_start(2, {80, 80}, 0);
  EXPECT_THAT(words(check_starts(*close.build(), 2)), HasSubstr("overlap"));
  MapPlan wall = plan;
  wall.add_start(2, {500, 100}, 0);
  EXPECT_THAT(words(check_starts(*wall.build(), 2)), AllOf(HasSubstr("(500, 100)"), HasSubstr("too near")));
  MapPlan rock = plan;
  rock.add_start(2, {700, 100}, 0);
  EXPECT_THAT(words(check_starts(*rock.build(), 2)), HasSubstr("rock"));
}

TEST(MapChecks, EightPlayersHaveStarts) {
  MapPlan plan = hall();
  for (int player = 1; player <= 8; ++player) plan.add_start(player, {40 * player, 100}, 0);
  const MapData map = *plan.build();
  EXPECT_EQ(words(check_starts(map, 8)), "");
  EXPECT_EQ(start_points(map).size(), 8u);
  EXPECT_EQ(start_points(map)[7], (Point{320, 100}));
}

TEST(MapChecks, SpotsComeInTheOrderOfTheirIds) {
  MapPlan plan = hall();
  plan.add_spot(11, {100, 100});
  plan.add_spot(10, {200, 200});
  plan.add_spot(99, {300, 300});
  EXPECT_THAT(spot_points(*plan.build(), 10, 20), testing::ElementsAre(Point{200, 200}, Point{100, 100}));
}

TEST(MapChecks, BridgesOpenWhatWasSeparate) {
  MapPlan plan;
  plan.add_area({.name = "lava", .floor = -80}, Box{{0, 0}, {900, 300}});
  plan.add_area({.name = "west"}, Box{{0, 100}, {200, 200}});
  plan.add_area({.name = "east"}, Box{{600, 100}, {800, 200}});
  plan.add_area({.name = "bridge", .floor = -80, .tag = 4}, Box{{180, 120}, {620, 180}});
  const MapData map = *plan.build();
  const Point from[] = {{100, 150}}, to[] = {{700, 150}};
  EXPECT_EQ(words(check_separated(map, from, to, "the east")), "");
  EXPECT_EQ(words(check_reaches(with_floors_at(map, {4}, 0), from, to, "the east")), "");
  EXPECT_THAT(words(check_reaches(map, from, to, "the east")), HasSubstr("the east at (700, 150)"));
}

}  // namespace map_checks_test
}  // namespace comrad::doomgen
