// The Hexen writer, pictures, the map from above, the node builder.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "doomgen/layout/hexen_writer.h"
#include "doomgen/layout/map_picture.h"
#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/node_builder.h"
#include "doomgen/layout/picture.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/wad_reader.h"

namespace comrad::doomgen {
namespace writers_test {

using testing::HasSubstr;

MapData two_rooms() {
  MapPlan plan;
  const AreaId west =
      plan.add_area({.name = "west", .floor = -8, .light = 200, .tag = 300}, Box{{0, 0}, {256, 256}});
  plan.add_area({.name = "east"}, Box{{256, 64}, {512, 192}});
  plan.connect(west, 1, Passage::window());
  plan.set_line({0, 0}, {0, 256},
                {.special = 80, .args = {12, 0, 1, 2, 3}, .repeatable = true, .player_use = true});
  plan.set_line({0, 0}, {256, 0}, {.id = 300});
  plan.add_start(1, {128, 128}, 90);
  plan.add_thing({.position = {64, 64},
                  .height = 16,
                  .angle_degrees = 45,
                  .editor_number = 3001,
                  .id = 7,
                  .special = 70,
                  .args = {1, 2, 3, 4, 5},
                  .ambush = true});
  return *plan.build();
}

Expected<wad::UdmfMap> read_back(const MapData& map) {
  COMRAD_TRY_ASSIGN(const HexenLumps lumps, write_hexen(map));
  WadWriter writer;
  COMRAD_TRY(writer.add_hexen_map("MAP01", lumps));
  COMRAD_TRY_ASSIGN(const std::string bytes, writer.bytes());
  COMRAD_TRY_ASSIGN(const wad::WadFile wad, wad::WadFile::from_bytes({bytes.begin(), bytes.end()}, "test"));
  COMRAD_TRY_ASSIGN(const wad::MapLumps found, wad.find_map("MAP01"));
  EXPECT_TRUE(wad::is_hexen_format(found));
  return wad::read_binary_map(wad, found, "test: MAP01");
}

TEST(HexenWriter, ReadsBackAsItWasWritten) {
  const MapData map = two_rooms();
  const auto again = read_back(map);
  ASSERT_TRUE(again) << again.error().message;
  ASSERT_EQ(again->vertices.size(), map.vertices.size());
  ASSERT_EQ(again->linedefs.size(), map.linedefs.size());
  ASSERT_EQ(again->sidedefs.size(), map.sidedefs.size());
  ASSERT_EQ(again->sectors.size(), 2u);
  EXPECT_EQ(again->sectors[0].height_floor, -8);
  EXPECT_EQ(again->sectors[0].light_level, 200);
  EXPECT_EQ(again->sectors[0].id, 300);
  for (std::size_t i = 0; i < map.linedefs.size(); ++i) {
    EXPECT_EQ(again->linedefs[i].blocking, map.linedefs[i].blocking);
    EXPECT_EQ(again->linedefs[i].side_front, static_cast<int32_t>(map.linedefs[i].front));
    if (map.linedefs[i].special == 80) {
      EXPECT_EQ(again->linedefs[i].special, 80);
      EXPECT_EQ(again->linedefs[i].args, map.linedefs[i].args);
      EXPECT_TRUE(again->linedefs[i].repeat_special && again->linedefs[i].player_use);
    }
    if (map.linedefs[i].id != 0) {
      EXPECT_EQ(again->linedefs[i].id, 300);
    }
  }
  ASSERT_EQ(again->things.size(), 2u);
  EXPECT_EQ(again->things[1].type, 3001);
  EXPECT_EQ(again->things[1].id, 7);
  EXPECT_EQ(again->things[1].special, 70);
  EXPECT_EQ(again->things[1].args[4], 5);
  EXPECT_TRUE(again->things[1].ambush && again->things[1].coop && again->things[1].skill[2]);
}

TEST(HexenWriter, ReportsWhatDoesNotFit) {
  MapData map = two_rooms();
  map.linedefs[0].id = 5, map.linedefs[0].special = 80;
  EXPECT_THAT(write_hexen(map).error().message, HasSubstr("both a special and an id"));
  map = two_rooms();
  map.things[1].args[0] = 300;
  EXPECT_THAT(write_hexen(map).error().message, HasSubstr("3001 at (64, 64)"));
  map = two_rooms();
  map.sectors[1].tag = 70000;
  EXPECT_THAT(write_hexen(map).error().message, HasSubstr("'east'"));
  map = two_rooms();
  map.sectors[0].extra = {{"lightcolor", "0xFF0000"}};
  const auto lumps = write_hexen(map);
  ASSERT_TRUE(lumps);
  EXPECT_THAT(lumps->warnings, testing::ElementsAre(HasSubstr("1 further UDMF field")));
}

TEST(UdmfWriter, WritesFurtherFields) {
  MapData map = two_rooms();
  map.sectors[0].extra = {{"lightcolor", "0xFF0000"}};
  EXPECT_THAT(write_udmf(map), HasSubstr("lightcolor = 0xFF0000;"));
}

TEST(Picture, APngOfKnownBytes) {
  Picture picture(2, 1, {1, 2, 3, 255});
  picture.at(1, 0) = {4, 5, 6, 0};
  const std::string png = encode_png(picture);
  EXPECT_EQ(png.substr(1, 3), "PNG");
  EXPECT_EQ(png.size(), 8u + 25 + (12 + 2 + 5 + 9 + 4) + 12);
  EXPECT_THAT(png, HasSubstr(std::string("\0\1\2\3\xFF\4\5\6\0", 9)));
  EXPECT_EQ(png.substr(png.size() - 4), "\xAE\x42\x60\x82") << "the checksum of every PNG's last chunk";
}

TEST(Picture, AnIndexedPngIsSmallAndHasAPalette) {
  Picture picture(1000, 1000, {1, 2, 3});
  picture.at(999, 999) = {4, 5, 6};
  const auto png = encode_indexed_png(picture);
  ASSERT_TRUE(png) << png.error().message;
  EXPECT_LT(png->size(), 2000u);
  EXPECT_THAT(*png, HasSubstr(std::string("\0\0\x03\xE8\0\0\x03\xE8\x08\x03\0\0\0", 13)))
      << "8 bits, indices";
  EXPECT_THAT(*png, HasSubstr(std::string("\0\0\0\x06PLTE\1\2\3\4\5\6", 14)));
  EXPECT_EQ(png->substr(png->size() - 4), "\xAE\x42\x60\x82");
  Picture colourful(257, 1, {});
  for (int x = 0; x < 257; ++x)
    colourful.at(x, 0) = {static_cast<uint8_t>(x), static_cast<uint8_t>(x >> 8), 0};
  const auto refused = encode_indexed_png(colourful);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("at most 256 colours"));
}

TEST(Picture, APatchHasPostsWhereThePictureIsOpaque) {
  std::string palette(768, '\0');
  palette[3 * 9] = '\xFF';  // entry 9 is red
  Picture picture(1, 4, {250, 10, 10, 255});
  picture.at(0, 1).alpha = 0;
  const auto patch = encode_patch(picture, palette);
  ASSERT_TRUE(patch);
  // Size, offsets, one column: a post of one pixel at row 0, one of two at row 2.
  EXPECT_EQ(*patch, std::string("\1\0\4\0\0\0\0\0\x0C\0\0\0"
                                "\0\1\0\x09\0\2\2\0\x09\x09\0\xFF",
                                24));
  EXPECT_FALSE(encode_patch(Picture(1, 255, {}), palette));
  EXPECT_FALSE(encode_patch(Picture(1, 1, {}), "short"));
}

TEST(MapPicture, ShowsFloorsWallsAndStarts) {
  const auto map = read_back(two_rooms());
  ASSERT_TRUE(map);
  const auto picture = draw_map(*map, 200);
  ASSERT_TRUE(picture) << picture.error().message;
  EXPECT_EQ(picture->width, 200);
  int walls = 0, starts = 0, floors = 0;
  for (const Colour& c : picture->pixels) {
    walls += c == Colour{240, 240, 240};
    starts += c == Colour{60, 220, 60};
    floors += c.blue == c.red + 12;
  }
  EXPECT_GT(walls, 300);
  EXPECT_GT(starts, 10);
  EXPECT_GT(floors, 200 * 50);
  EXPECT_FALSE(draw_map(*map, 1));
  EXPECT_FALSE(draw_map({}, 100));
}

TEST(MapPicture, ShowsWhatThingsAreAndFitsAPalette) {
  auto map = read_back(two_rooms());
  ASSERT_TRUE(map);
  ASSERT_FALSE(map->things.empty());
  const wad::UdmfThing start = map->things[0];
  for (const auto& [type, name] :
       std::vector<std::pair<int32_t, std::string>>{{4004, "player starts"},
                                                    {9001, "map spots"},
                                                    {3001, "monsters"},
                                                    {2001, "weapons"},
                                                    {2007, "ammunition"},
                                                    {2012, "health, armour and power-ups"},
                                                    {40, "keys and skulls"},
                                                    {-5, "other things"}}) {
    const ThingKind& kind = kind_of_thing(type);
    EXPECT_EQ(kind.name, name);
    map->things = {start};
    map->things[0].type = type;
    const auto picture = draw_map(*map, 200);
    ASSERT_TRUE(picture);
    EXPECT_GT(std::ranges::count(picture->pixels, kind.colour), 5) << name;
    const auto png = encode_indexed_png(*picture);
    ASSERT_TRUE(png);
    EXPECT_LT(png->size(), 4000u);
  }
}

TEST(NodeBuilder, EitherBuildsNodesOrReportsThatTheProgramIsMissing) {
  WadWriter writer;
  ASSERT_TRUE(writer.add_hexen_map("MAP01", *write_hexen(two_rooms())));
  const auto built = build_nodes(*writer.bytes());
  if (built)
    EXPECT_GT(built->size(), writer.bytes()->size());
  else
    EXPECT_THAT(built.error().message, HasSubstr("zdbsp is not installed"));
}

}  // namespace writers_test
}  // namespace comrad::doomgen
