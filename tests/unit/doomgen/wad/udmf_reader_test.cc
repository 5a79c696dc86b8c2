#include "doomgen/wad/udmf_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/wad_bytes.h"

namespace comrad::wad {
namespace udmf_reader_test {

using ::testing::HasSubstr;
using ::testing::StartsWith;

UdmfMap good(std::string_view text) { return parse_udmf(text, "t").value(); }

std::string message_of(std::string_view text) {
  const Expected<UdmfMap> map = parse_udmf(text, "t");
  return map ? "" : map.error().message;
}

TEST(UdmfReader, ReadsAWholeMap) {
  const UdmfMap map = good(test::square_room_text());
  EXPECT_EQ(map.name_space, "zdoom");
  ASSERT_EQ(map.things.size(), 2u);
  EXPECT_EQ(map.things[1].x, 64.5);
  EXPECT_EQ(map.things[1].y, -32.25);
  EXPECT_EQ(map.things[1].type, 2011);
  EXPECT_EQ(map.things[1].id, 7);
  EXPECT_TRUE(map.things[1].skill[2]);
  EXPECT_FALSE(map.things[1].skill[1]);
  ASSERT_EQ(map.vertices.size(), 4u);
  ASSERT_EQ(map.linedefs.size(), 4u);
  EXPECT_EQ(map.linedefs[3].v2, 0);
  EXPECT_EQ(map.linedefs[3].side_back, -1);
  EXPECT_TRUE(map.linedefs[3].blocking);
  EXPECT_EQ(map.sidedefs[2].offset_x, 16);
  EXPECT_EQ(map.sidedefs[2].texture_middle, "BRICK6");
  EXPECT_EQ(map.sidedefs[2].texture_top, "-");
  ASSERT_EQ(map.sectors.size(), 1u);
  EXPECT_EQ(map.sectors[0].texture_floor, "FLAT1");
  EXPECT_EQ(map.sectors[0].light_level, 200);
  EXPECT_EQ(map.sectors[0].id, 900);
}

TEST(UdmfReader, ReadsEveryFormOfNumber) {
  const UdmfMap map =
      good("vertex { x = 1e2; y = -.5; } vertex { x = +3.25; y = 0x1F; } vertex { x = 010; y = -7; }");
  EXPECT_EQ(map.vertices[0].x, 100.0);
  EXPECT_EQ(map.vertices[0].y, -0.5);
  EXPECT_EQ(map.vertices[1].x, 3.25);
  EXPECT_EQ(map.vertices[1].y, 31.0);
  EXPECT_EQ(map.vertices[2].x, 8.0);
  EXPECT_EQ(map.vertices[2].y, -7.0);
}

TEST(UdmfReader, SkipsCommentsUnknownKeysAndUnknownBlocks) {
  const UdmfMap map = good(
      "// a line\n/* a { block = } */ NameSpace = \"zdoom\"; user_thing = \"a \\\" b\";\n"
      "light { colour = 3; }\nVERTEX { X = 1; user_note = \"}\"; y /* here */ = 2; }");
  EXPECT_EQ(map.name_space, "zdoom");
  ASSERT_EQ(map.vertices.size(), 1u);
  EXPECT_EQ(map.vertices[0].y, 2.0);
}

TEST(UdmfReader, AnEmptyTextIsAnEmptyMap) { EXPECT_TRUE(good("").vertices.empty()); }

TEST(UdmfReader, ReadsArgumentsAndFlags) {
  const UdmfMap map = good(
      "linedef { v1 = 0; v2 = 1; sidefront = 0; sideback = 1; twosided = true; special = 80; arg0 = 5; arg4 "
      "= -9;"
      " dontpegtop = true; dontpegbottom = true; blockmonsters = true; blockeverything = false; id = 3; }");
  const UdmfLinedef& line = map.linedefs.at(0);
  EXPECT_EQ(line.special, 80);
  EXPECT_EQ(line.args[0], 5);
  EXPECT_EQ(line.args[4], -9);
  EXPECT_TRUE(line.two_sided && line.dont_peg_top && line.dont_peg_bottom && line.block_monsters);
  EXPECT_FALSE(line.block_everything);
  EXPECT_EQ(line.id, 3);
}

TEST(UdmfReader, ErrorsNameLineAndColumn) {
  EXPECT_THAT(message_of("vertex {\n  x = 1;\n  y 2;\n}"), StartsWith("t:3:5: expected '=' after 'y'"));
  EXPECT_THAT(message_of("\n\n  @"), StartsWith("t:3:3: unexpected character '@'"));
}

TEST(UdmfReader, RefusesBrokenText) {
  EXPECT_THAT(message_of("vertex { x = 1; y = 2;"), HasSubstr("never ends"));
  EXPECT_THAT(message_of("/* no end"), HasSubstr("comment never ends"));
  EXPECT_THAT(message_of("namespace = \"zdoom"), HasSubstr("string never ends"));
  EXPECT_THAT(message_of("namespace = \"zdoom\\"), HasSubstr("string never ends"));
  EXPECT_THAT(message_of("namespace = zdoom;"), HasSubstr("requires a string"));
  EXPECT_THAT(message_of("vertex"), HasSubstr("found the end of the text"));
  EXPECT_THAT(message_of("vertex { x = 1 y = 2; }"), HasSubstr("expected ';'"));
  EXPECT_THAT(message_of("vertex { x = ; y = 2; }"), HasSubstr("expected a value for 'x'"));
  EXPECT_THAT(message_of("vertex { 5 = 1; }"), HasSubstr("expected a key"));
  EXPECT_THAT(message_of("{ }"), HasSubstr("expected a key or the name of a block"));
}

TEST(UdmfReader, RefusesBadValues) {
  EXPECT_THAT(message_of("vertex { x = 1.2.3; y = 0; }"), HasSubstr("no number"));
  EXPECT_THAT(message_of("vertex { x = 1e999; y = 0; }"), HasSubstr("no number"));
  EXPECT_THAT(message_of("vertex { x = 99999999999999999999999; y = 0; }"), HasSubstr("no number"));
  EXPECT_THAT(message_of("vertex { x = \"a\"; y = 0; }"), HasSubstr("requires a number"));
  EXPECT_THAT(message_of("linedef { v1 = 0.5; v2 = 1; sidefront = 0; }"), HasSubstr("whole number"));
  EXPECT_THAT(message_of("linedef { v1 = 3000000000; v2 = 1; sidefront = 0; }"), HasSubstr("whole number"));
  EXPECT_THAT(message_of("linedef { v1 = 0; v2 = 1; sidefront = 0; blocking = 1; }"),
              HasSubstr("true or false"));
  EXPECT_THAT(message_of("sidedef { sector = 0; texturetop = 4; }"), HasSubstr("requires a string"));
}

TEST(UdmfReader, NamesTheKeyThatABlockLacks) {
  EXPECT_THAT(message_of("vertex { x = 1; }"), HasSubstr("has no 'y'"));
  EXPECT_THAT(message_of("linedef { v1 = 0; sidefront = 0; }"), HasSubstr("has no 'v2'"));
  EXPECT_THAT(message_of("sidedef { }"), HasSubstr("has no 'sector'"));
  EXPECT_THAT(message_of("sector { texturefloor = \"A\"; }"), HasSubstr("has no 'textureceiling'"));
  EXPECT_THAT(message_of("thing { x = 1; y = 2; }"), HasSubstr("has no 'type'"));
}

TEST(Udmf, ReadsWhatLinesSidesSectorsAndThingsSayBesides) {
  const UdmfMap map = parse_udmf(R"(namespace = "zdoom";
    linedef { v1 = 0; v2 = 1; sidefront = 0; blockhitscan = true; repeatspecial = true; playeruse = true;
      monstercross = true; arg0str = "open"; alpha = 0.5; locknumber = 3; jumpover = true; midtex3d = true; }
    sidedef { sector = 0; offsetx_mid = 8.5; scaley_bottom = 2.0; light = -16; lightabsolute = true; }
    sector { texturefloor = "A"; textureceiling = "B"; lightcolor = 0xFF8000; xpanningfloor = 4.0;
      rotationceiling = 90.0; gravity = 0.5; damagetype = "Slime"; leakiness = 5; secret = true;
      floorplane_a = 1.0; }
    thing { x = 1; y = 2; type = 3; skill7 = true; class2 = false; friend = true; standing = true;
      scale = 2.0; health = -30; class17 = false; classic = 1; })",
                                 "t")
                          .value();
  const UdmfLinedef& line = map.linedefs[0];
  EXPECT_TRUE(line.block_hitscan && line.repeat_special && line.player_use && line.monster_cross &&
              line.jump_over && line.midtex_3d);
  EXPECT_FALSE(line.block_sight || line.player_cross || line.impact);
  EXPECT_EQ(line.arg0_text, "OPEN");
  EXPECT_EQ(line.alpha, 0.5);
  EXPECT_EQ(line.lock_number, 3);
  const UdmfSidedef& side = map.sidedefs[0];
  EXPECT_EQ(side.parts[1].offset_x, 8.5);
  EXPECT_EQ(side.parts[2].scale_y, 2.0);
  EXPECT_EQ(side.parts[0].offset_x, 0.0);
  EXPECT_TRUE(side.light == -16 && side.light_absolute);
  const UdmfSector& sector = map.sectors[0];
  EXPECT_EQ(sector.light_color, 0xFF8000);
  EXPECT_EQ(sector.floor.panning_x, 4.0);
  EXPECT_EQ(sector.ceiling.rotation, 90.0);
  EXPECT_EQ(sector.gravity, 0.5);
  EXPECT_EQ(sector.damage_type, "SLIME");
  EXPECT_TRUE(sector.leakiness == 5 && sector.secret && sector.is_sloped);
  const UdmfThing& thing = map.things[0];
  EXPECT_TRUE(thing.skill[6] && !thing.skill[5] && thing.friendly && thing.standing);
  EXPECT_EQ(thing.class_filter, 0xFFFDu);
  EXPECT_EQ(thing.scale_y, 2.0);
  EXPECT_EQ(thing.health, -30);
}

// Probe: monsters with health = 1.0, 2.0, -50.0 are dead when the map begins, those with 2 and -50 are not.
TEST(UdmfReader, AHealthWithAPointIsNone) {
  for (const auto& [text, health] :
       {std::pair{"2", 2}, {"-50", -50}, {"1.0", 0}, {"2.0", 0}, {"-50.0", 0}, {"0.5", 0}})
    EXPECT_EQ(
        good(std::string("namespace = \"zdoom\"; thing { x = 0; y = 0; type = 1; health = ") + text + "; }")
            .things[0]
            .health,
        health)
        << text;
}

}  // namespace udmf_reader_test
}  // namespace comrad::wad
