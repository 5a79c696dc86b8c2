#include "doomgen/layout/reachability.h"

#include <gtest/gtest.h>

#include "doomgen/layout/map_plan.h"

namespace comrad::doomgen {
namespace reachability_test {

constexpr Point kStart[] = {{64, 64}};

/// Two rooms of 256 joined by a hall of the given width and heights.
MapData two_rooms(int32_t width, int32_t hall_floor, int32_t hall_ceiling, bool blocking = false) {
  MapPlan plan;
  const AreaId west = plan.add_area({.name = "west"}, Box{{0, 0}, {256, 256}});
  const AreaId hall = plan.add_area({.name = "hall", .floor = hall_floor, .ceiling = hall_ceiling},
                                    Box{{256, 100}, {384, 100 + width}});
  plan.add_area({.name = "east"}, Box{{384, 0}, {640, 256}});
  if (blocking) plan.connect(west, hall, Passage::window(""));
  const auto map = plan.build();
  COMRAD_CHECK(map.has_value(), map ? "" : map.error().message);
  return *map;
}

TEST(Reachability, ABodyPassesWhereItFits) {
  EXPECT_TRUE(Reachability(two_rooms(48, 0, 128), kStart).reaches({500, 128}));
  EXPECT_FALSE(Reachability(two_rooms(31, 0, 128), kStart).reaches({500, 128}));
}

TEST(Reachability, AStepOf24CanBeClimbedAndOneOf25CanNot) {
  EXPECT_TRUE(Reachability(two_rooms(48, 24, 128), kStart).reaches({500, 128}));
  EXPECT_FALSE(Reachability(two_rooms(48, 25, 128), kStart).reaches({500, 128}));
}

TEST(Reachability, AnOpeningMustBeAsHighAsTheBody) {
  EXPECT_TRUE(Reachability(two_rooms(48, 0, 56), kStart).reaches({500, 128}));
  EXPECT_FALSE(Reachability(two_rooms(48, 0, 55), kStart).reaches({500, 128}));
}

TEST(Reachability, BlockingLinesStop) {
  EXPECT_FALSE(Reachability(two_rooms(48, 0, 128, true), kStart).reaches({500, 128}));
}

TEST(Reachability, NothingOutsideTheMapIsReached) {
  const Reachability walk(two_rooms(48, 0, 128), kStart);
  EXPECT_FALSE(walk.reaches({320, 240}));
  EXPECT_FALSE(walk.reaches({5000, 5000}));
  EXPECT_FALSE(walk.reaches({-200, 64}));
}

}  // namespace reachability_test
}  // namespace comrad::doomgen
