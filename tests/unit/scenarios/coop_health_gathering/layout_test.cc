#include "scenarios/coop_health_gathering/layout.h"

#include <gtest/gtest.h>

#include <set>

#include "doomgen/layout/map_validation.h"
#include "doomgen/layout/reachability.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/udmf_reader.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios::coop_health_gathering {
namespace layout_test {

std::map<std::string, int64_t> defaults() {
  std::map<std::string, int64_t> values;
  for (const LayoutParameter& parameter : parameters()) values[parameter.name] = parameter.default_value;
  return values;
}

std::vector<doomgen::Point> things_of(const doomgen::MapData& map, int32_t low, int32_t high) {
  std::vector<doomgen::Point> points;
  for (const doomgen::ThingData& thing : map.things)
    if (thing.editor_number >= low && thing.editor_number <= high) points.push_back(thing.position);
  return points;
}

std::vector<doomgen::Point> spots_of(const DrawnLayout& layout) {
  std::vector<doomgen::Point> points;
  if (layout.arrays.size() != 2 || layout.arrays[0].first != "spot_x" || layout.arrays[1].first != "spot_y")
    return points;
  const std::vector<int64_t>&x = layout.arrays[0].second, &y = layout.arrays[1].second;
  for (std::size_t i = 0; i < x.size(); ++i)
    points.push_back({static_cast<int32_t>(x[i]), static_cast<int32_t>(y.at(i))});
  return points;
}

TEST(CoopHealthGatheringLayout, TwentySeedsGiveValidMaps) {
  int refused = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    const auto drawn = draw(seed, defaults());
    if (!drawn) {  // allowed: the generator then advances the seed
      ++refused;
      continue;
    }
    const doomgen::MapData* const map = &drawn->map;
    ASSERT_TRUE(doomgen::validate_map(*map));
    const auto starts = things_of(*map, 1, 4), spots = spots_of(*drawn);
    ASSERT_EQ(starts.size(), 4u);
    ASSERT_EQ(spots.size(), 300u);
    ASSERT_EQ(map->sectors.size(), 1u);
    ASSERT_EQ(map->sectors[0].tag, 900);
    for (std::size_t i = 0; i < starts.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) ASSERT_GE(doomgen::distance_squared(starts[i], starts[j]), 64 * 64);
      for (const doomgen::LinedefData& line : map->linedefs)
        ASSERT_FALSE(doomgen::nearer_than(starts[i], map->vertices[line.start], map->vertices[line.end], 32));
    }
    for (const doomgen::Point& spot : spots)
      for (const doomgen::LinedefData& line : map->linedefs)
        ASSERT_FALSE(doomgen::nearer_than(spot, map->vertices[line.start], map->vertices[line.end], 24));
  }
  EXPECT_LE(refused, 1);
}

TEST(CoopHealthGatheringLayout, TheDefaultMapNeverChanges) {
  const auto first = generate_layout("coop_health_gathering", {.seed = 42});
  const auto second = generate_layout("coop_health_gathering", {.seed = 42});
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->wad, second->wad);
  // The same map on every machine and compiler: published results name the layout by its seed alone. Kit
  // spots are in the script, whose bytes may change with it.
  const auto drawn = draw(42, defaults());
  ASSERT_TRUE(drawn);
  EXPECT_EQ(doomgen::content_hash(doomgen::write_udmf(drawn->map)), 0x6fb23e7089b9bc3cull);
  uint64_t spots = 0;
  for (const doomgen::Point& spot : spots_of(*drawn))
    spots = mix64(spots ^ (uint64_t{static_cast<uint32_t>(spot.x)} << 32 | static_cast<uint32_t>(spot.y)));
  EXPECT_EQ(spots, 0xfda28d0b4badfd3ull);
}

TEST(CoopHealthGatheringLayout, SeedsDiffer) {
  std::set<uint64_t> hashes;
  for (uint64_t seed = 0; seed < 20; ++seed)
    hashes.insert(doomgen::content_hash(doomgen::write_udmf(draw(seed, defaults())->map)));
  EXPECT_EQ(hashes.size(), 20u);
}

TEST(CoopHealthGatheringLayout, GeometryIsThatOfTheSpecification) {
  for (uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8}) {
    SCOPED_TRACE(seed);
    const auto drawn = draw(seed, defaults());
    ASSERT_TRUE(drawn);
    const doomgen::MapData* const map = &drawn->map;
    int outline_lines = 0, pillar_lines = 0;
    for (const doomgen::LinedefData& line : map->linedefs) {
      ASSERT_FALSE(line.back);
      const doomgen::Point a = map->vertices[line.start], b = map->vertices[line.end];
      if (map->sidedefs[line.front].middle == "ASHWALL6") {
        ++pillar_lines;
        const int64_t length_squared = doomgen::distance_squared(a, b);
        EXPECT_GE(length_squared, 48 * 48);
        EXPECT_LE(length_squared, 128 * 128);
      } else {
        ++outline_lines;
        const int64_t radius_squared = doomgen::distance_squared(a, {0, 0});
        EXPECT_GE(radius_squared, 1199 * 1199);
        EXPECT_LE(radius_squared, 2001 * 2001);
      }
    }
    EXPECT_GE(outline_lines, 12);
    EXPECT_LE(outline_lines, 24);
    EXPECT_GE(pillar_lines / 4, 90);  // 122 tries less those in the middle
    EXPECT_LE(pillar_lines / 4, 122);
  }
}

TEST(CoopHealthGatheringLayout, AllAxisValuesGiveMaps) {
  for (const char* radius : {"1600", "2400"})
    for (const char* density : {"450", "750"})
      for (const char* tether : {"320", "480"})
        for (const char* players : {"2", "4"}) {
          const auto layout = generate_layout(
              "coop_health_gathering",
              {.parameters = {
                   {"radius", radius}, {"density", density}, {"tether", tether}, {"players", players}}});
          EXPECT_TRUE(layout) << radius << " " << density << " " << tether << " " << players;
        }
}

TEST(CoopHealthGatheringLayout, ReadsBackAsItWasWritten) {
  const auto drawn = draw(42, defaults());
  ASSERT_TRUE(drawn);
  const doomgen::MapData* const map = &drawn->map;
  const auto again = wad::parse_udmf(doomgen::write_udmf(*map), "test");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->name_space, "zdoom");
  ASSERT_EQ(again->vertices.size(), map->vertices.size());
  ASSERT_EQ(again->linedefs.size(), map->linedefs.size());
  ASSERT_EQ(again->sidedefs.size(), map->sidedefs.size());
  ASSERT_EQ(again->sectors.size(), map->sectors.size());
  ASSERT_EQ(again->things.size(), map->things.size());
  for (std::size_t i = 0; i < map->vertices.size(); ++i) {
    EXPECT_EQ(again->vertices[i].x, map->vertices[i].x);
    EXPECT_EQ(again->vertices[i].y, map->vertices[i].y);
  }
  for (std::size_t i = 0; i < map->linedefs.size(); ++i) {
    EXPECT_EQ(again->linedefs[i].v1, static_cast<int32_t>(map->linedefs[i].start));
    EXPECT_EQ(again->linedefs[i].v2, static_cast<int32_t>(map->linedefs[i].end));
    EXPECT_EQ(again->linedefs[i].side_front, static_cast<int32_t>(map->linedefs[i].front));
    EXPECT_EQ(again->linedefs[i].blocking, map->linedefs[i].blocking);
  }
  for (std::size_t i = 0; i < map->sidedefs.size(); ++i)
    EXPECT_EQ(again->sidedefs[i].texture_middle, map->sidedefs[i].middle);
  EXPECT_EQ(again->sectors[0].height_ceiling, 384);
  EXPECT_EQ(again->sectors[0].texture_floor, "FLAT1");
  EXPECT_EQ(again->sectors[0].texture_ceiling, "CEIL1_2");
  EXPECT_EQ(again->sectors[0].light_level, 200);
  EXPECT_EQ(again->sectors[0].id, 900);
  for (std::size_t i = 0; i < map->things.size(); ++i) {
    EXPECT_EQ(again->things[i].type, map->things[i].editor_number);
    EXPECT_EQ(again->things[i].id, map->things[i].id);
    EXPECT_EQ(again->things[i].angle, map->things[i].angle_degrees);
    EXPECT_TRUE(again->things[i].skill[2] && again->things[i].coop && again->things[i].single);
  }
}

}  // namespace layout_test
}  // namespace comrad::scenarios::coop_health_gathering
