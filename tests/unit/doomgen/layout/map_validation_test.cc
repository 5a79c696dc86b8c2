#include "doomgen/layout/map_validation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace comrad::doomgen {
namespace map_validation_test {

using testing::HasSubstr;

Polygon box(int32_t x0, int32_t y0, int32_t x1, int32_t y1) { return Box{{x0, y0}, {x1, y1}}.polygon(); }
const Polygon kRoom = box(0, 0, 256, 256);

/// Adds one-sided lines along an outline, `sector` to their right.
void add_walls(MapData& map, uint32_t sector, Polygon outline, bool is_hole = false) {
  if ((twice_area(outline) < 0) == is_hole) std::reverse(outline.begin(), outline.end());
  const auto first = static_cast<uint32_t>(map.vertices.size());
  const auto count = static_cast<uint32_t>(outline.size());
  map.vertices.insert(map.vertices.end(), outline.begin(), outline.end());
  for (uint32_t i = 0; i < count; ++i) {
    LinedefData line;
    line.start = first + i, line.end = first + (i + 1) % count;
    line.front = static_cast<uint32_t>(map.sidedefs.size());
    line.blocking = true;
    map.sidedefs.push_back({sector, "", "STARTAN3", ""});
    map.linedefs.push_back(line);
  }
}

/// A sector for each outline.
MapData rooms(const std::vector<Polygon>& outlines) {
  MapData map;
  for (const Polygon& outline : outlines) {
    add_walls(map, static_cast<uint32_t>(map.sectors.size()), outline);
    map.sectors.emplace_back();
  }
  return map;
}

void expect_refused(const MapData& map, const char* message) {
  const Status status = validate_map(map);
  ASSERT_FALSE(status) << "should fail with: " << message;
  EXPECT_EQ(status.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(status.error().message, HasSubstr(message));
}

TEST(ValidateMap, TakesRoomsWithAndWithoutPillars) {
  MapData map = rooms({kRoom, box(512, 0, 768, 256)});
  EXPECT_TRUE(validate_map(map));
  add_walls(map, 0, box(64, 64, 128, 128), true);
  EXPECT_TRUE(validate_map(map));
}

TEST(ValidateMap, RefusesAnEmptyMap) { expect_refused({}, "no area"); }

TEST(ValidateMap, RefusesCrossingAreas) { expect_refused(rooms({kRoom, box(128, 128, 384, 384)}), "cross"); }

TEST(ValidateMap, RefusesAnAreaInsideAnotherThatWasNotCutOut) {
  expect_refused(rooms({kRoom, box(64, 64, 128, 128)}), "overlap");
}

TEST(ValidateMap, RefusesAPillarOutsideItsArea) {
  MapData map = rooms({kRoom});
  add_walls(map, 0, box(300, 300, 400, 400), true);
  expect_refused(map, "sticks out");
}

TEST(ValidateMap, RefusesSlivers) {
  expect_refused(rooms({{{0, 0}, {3000, 1}, {3000, 1000}, {1000, 1}}}), "less than one unit");
}

TEST(ValidateMap, RefusesAnOutlineThatCrossesItself) {
  expect_refused(rooms({{{0, 0}, {100, 100}, {100, 0}, {0, 90}}}), "cross");
}

TEST(ValidateMap, RefusesCoordinatesBeyondTheFormat) {
  expect_refused(rooms({box(0, 0, 16385, 100)}), "16384");
}

TEST(ValidateMap, RefusesNamesThatNoLumpCanHave) {
  MapData map = rooms({kRoom});
  map.sectors[0].floor_texture = "flat\";";
  expect_refused(map, "flat");
}

TEST(ValidateMap, FindsASectorThatIsNotClosed) {
  MapData map = rooms({kRoom});
  ASSERT_TRUE(validate_map(map));
  map.linedefs.pop_back();
  const Status status = validate_map(map);
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("not closed"));
}

TEST(ValidateMap, FindsALineThatFacesTheWrongWay) {
  MapData map = rooms({kRoom});
  for (LinedefData& line : map.linedefs) std::swap(line.start, line.end);
  EXPECT_FALSE(validate_map(map));
}

TEST(ValidateMap, FindsReferencesToNothing) {
  const MapData good = rooms({kRoom});
  MapData map = good;
  map.linedefs[0].end = 99;
  EXPECT_FALSE(validate_map(map));
  map = good;
  map.linedefs[0].front = 99;
  EXPECT_FALSE(validate_map(map));
  map = good;
  map.sidedefs[0].sector = 99;
  EXPECT_FALSE(validate_map(map));
}

}  // namespace map_validation_test
}  // namespace comrad::doomgen
