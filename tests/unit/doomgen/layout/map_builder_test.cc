#include "doomgen/layout/map_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::doomgen {
namespace {

using testing::HasSubstr;

Polygon box(int32_t x0, int32_t y0, int32_t x1, int32_t y1) { return Box{{x0, y0}, {x1, y1}}.polygon(); }

int two_sided_count(const MapData& map) {
  int count = 0;
  for (const LinedefData& line : map.linedefs) count += line.back.has_value();
  return count;
}

TEST(MapBuilder, OneRoomHasItsWallsFacingInwards) {
  MapBuilder builder;
  builder.add_area({}, "STARTAN3", box(0, 0, 128, 128));
  const auto map = builder.build();
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->linedefs.size(), 4u);
  EXPECT_EQ(map->vertices.size(), 4u);
  for (const LinedefData& line : map->linedefs) {
    const Point a = map->vertices[line.start], b = map->vertices[line.end];
    EXPECT_LT(cross(a, b, {64, 64}), 0) << "the room lies to the right of every wall";
    EXPECT_TRUE(line.blocking);
    EXPECT_EQ(map->sidedefs[line.front].middle, "STARTAN3");
  }
}

TEST(MapBuilder, EitherTurningSenseGivesTheSameRoom) {
  MapBuilder clockwise, counter_clockwise;
  Polygon outline = box(0, 0, 128, 128);
  counter_clockwise.add_area({}, "WALL", outline);
  std::reverse(outline.begin(), outline.end());
  clockwise.add_area({}, "WALL", outline);
  EXPECT_TRUE(clockwise.build() && counter_clockwise.build());
}

TEST(MapBuilder, CommonEdgesBecomeTwoSidedEvenWhereTheirCornersDiffer) {
  MapBuilder builder;
  const int room = builder.add_area({.floor_height = 0}, "A", box(0, 0, 256, 256));
  const int hall = builder.add_area({.floor_height = 16}, "B", box(256, 64, 512, 192));
  const auto map = builder.build();
  ASSERT_TRUE(map) << map.error().message;
  ASSERT_EQ(two_sided_count(*map), 1);
  EXPECT_EQ(map->linedefs.size(), 3u + 3u + 3u);  // the room's east wall is cut into wall, opening, wall
  for (const LinedefData& line : map->linedefs) {
    if (!line.back) continue;
    const SidedefData &front = map->sidedefs[line.front], &back = map->sidedefs[*line.back];
    EXPECT_EQ(front.sector, static_cast<uint32_t>(room));
    EXPECT_EQ(back.sector, static_cast<uint32_t>(hall));
    EXPECT_EQ(front.bottom, "B") << "the step shows the texture of the area whose step it is";
    EXPECT_EQ(front.top, "A");
    EXPECT_FALSE(line.blocking);
  }
}

TEST(MapBuilder, AConnectionCanBarTheCommonEdges) {
  MapBuilder builder;
  const int room = builder.add_area({}, "A", box(0, 0, 256, 256));
  const int cell = builder.add_area({}, "B", box(256, 0, 512, 256));
  builder.connect(cell, room, {.blocking = true, .middle_texture = "MIDGRATE"});
  const auto map = builder.build();
  ASSERT_TRUE(map);
  for (const LinedefData& line : map->linedefs)
    if (line.back) {
      EXPECT_TRUE(line.blocking);
      EXPECT_EQ(map->sidedefs[line.front].middle, "MIDGRATE");
    }
}

TEST(MapBuilder, PillarsAreRockAndInsetsAreAreas) {
  MapBuilder builder;
  const int room = builder.add_area({}, "A", box(0, 0, 512, 512));
  builder.add_pillar(room, box(64, 64, 128, 128), "PILLAR");
  const int pool = builder.add_inset(room, {.floor_height = -16, .tag = 7}, "B", box(256, 256, 320, 320));
  const auto map = builder.build();
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->sectors.size(), 2u);
  EXPECT_EQ(map->sectors[static_cast<std::size_t>(pool)].tag, 7);
  EXPECT_EQ(map->linedefs.size(), 12u);
  EXPECT_EQ(two_sided_count(*map), 4);
  int pillar_walls = 0;
  for (const SidedefData& side : map->sidedefs) pillar_walls += side.middle == "PILLAR";
  EXPECT_EQ(pillar_walls, 4);
  EXPECT_EQ(builder.region(room).holes.size(), 2u);
}

/// A builder whose build() must fail with a message.
void expect_refused(const MapBuilder& builder, const char* message) {
  const auto map = builder.build();
  ASSERT_FALSE(map) << "should fail with: " << message;
  EXPECT_EQ(map.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(map.error().message, HasSubstr(message));
}

TEST(MapBuilder, RefusesAnEmptyMap) { expect_refused(MapBuilder{}, "no area"); }

TEST(MapBuilder, RefusesCrossingAreas) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 256, 256));
  builder.add_area({}, "B", box(128, 128, 384, 384));
  expect_refused(builder, "cross");
}

TEST(MapBuilder, RefusesTheSameAreaTwice) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 256, 256));
  builder.add_area({}, "B", box(0, 0, 256, 256));
  expect_refused(builder, "overlap");
}

TEST(MapBuilder, RefusesAnAreaInsideAnotherThatWasNotCutOut) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 256, 256));
  builder.add_area({}, "B", box(64, 64, 128, 128));
  expect_refused(builder, "overlap");
}

TEST(MapBuilder, RefusesAPillarOutsideItsArea) {
  MapBuilder builder;
  builder.add_pillar(builder.add_area({}, "A", box(0, 0, 256, 256)), box(300, 300, 400, 400), "P");
  expect_refused(builder, "sticks out");
}

TEST(MapBuilder, RefusesSlivers) {
  MapBuilder builder;
  builder.add_area({}, "A", {{0, 0}, {3000, 1}, {3000, 1000}, {1000, 1}});
  expect_refused(builder, "less than one unit");
}

TEST(MapBuilder, RefusesAnOutlineWithoutArea) {
  MapBuilder builder;
  builder.add_area({}, "A", {{0, 0}, {10, 0}, {20, 0}});
  expect_refused(builder, "no area");
}

TEST(MapBuilder, RefusesAnOutlineThatCrossesItself) {
  MapBuilder builder;
  builder.add_area({}, "A", {{0, 0}, {100, 100}, {100, 0}, {0, 90}});
  expect_refused(builder, "cross");
}

TEST(MapBuilder, RefusesCoordinatesBeyondTheFormat) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 16385, 100));
  expect_refused(builder, "16384");
}

TEST(MapBuilder, RefusesNamesThatNoLumpCanHave) {
  MapBuilder builder;
  builder.add_area({.floor_texture = "flat\";"}, "A", box(0, 0, 100, 100));
  expect_refused(builder, "flat");
}

TEST(ValidateMap, FindsASectorThatIsNotClosed) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 256, 256));
  MapData map = *builder.build();
  ASSERT_TRUE(validate_map(map));
  map.linedefs.pop_back();
  const Status status = validate_map(map);
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("not closed"));
}

TEST(ValidateMap, FindsALineThatFacesTheWrongWay) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 256, 256));
  MapData map = *builder.build();
  for (LinedefData& line : map.linedefs) std::swap(line.start, line.end);
  EXPECT_FALSE(validate_map(map));
}

TEST(ValidateMap, FindsReferencesToNothing) {
  MapBuilder builder;
  builder.add_area({}, "A", box(0, 0, 256, 256));
  const MapData good = *builder.build();
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

}  // namespace
}  // namespace comrad::doomgen
