#include "doomgen/layout/wad_writer.h"

#include <gtest/gtest.h>

#include "doomgen/layout/udmf_writer.h"

namespace comrad::doomgen {
namespace wad_writer_test {

TEST(WadWriter, WritesHeaderDataAndDirectory) {
  WadWriter wad;
  ASSERT_TRUE(wad.add("MAP01", ""));
  ASSERT_TRUE(wad.add("TEXTMAP", "abc"));
  const std::string bytes = *wad.bytes();
  const std::string expected(
      "PWAD\x02\0\0\0\x0F\0\0\0"
      "abc"
      "\x0C\0\0\0\0\0\0\0MAP01\0\0\0"
      "\x0C\0\0\0\x03\0\0\0TEXTMAP\0",
      12 + 3 + 32);
  EXPECT_EQ(bytes, expected);
}

TEST(WadWriter, AnEmptyFileIsAHeader) { EXPECT_EQ(WadWriter().bytes()->size(), 12u); }

TEST(WadWriter, RefusesNamesThatADirectoryCannotHold) {
  WadWriter wad;
  for (const char* name : {"", "NINELETTE", "lower", "SPA CE"}) EXPECT_FALSE(wad.add(name, "")) << name;
}

TEST(WadWriter, AUdmfMapIsMarkerTextAndEnd) {
  WadWriter without, with;
  ASSERT_TRUE(without.add_udmf_map("MAP01", "text"));
  ASSERT_TRUE(with.add_udmf_map("MAP01", "text", "ACS"));
  EXPECT_EQ((*without.bytes())[4], 3);
  EXPECT_EQ((*with.bytes())[4], 4);
}

TEST(WadWriter, ContentHashIsFnv1a64) {
  EXPECT_EQ(content_hash(""), 0xCBF29CE484222325ull);
  EXPECT_EQ(content_hash("a"), 0xAF63DC4C8601EC8Cull);
  EXPECT_EQ(content_hash("foobar"), 0x85944171F73967E8ull);
}

TEST(UdmfWriter, PrintsEveryBlockAndLeavesDefaultsOut) {
  MapData map;
  map.vertices = {{-16, 32}};
  map.sectors = {{.floor_height = 0,
                  .ceiling_height = 384,
                  .floor_texture = "FLAT1",
                  .ceiling_texture = "CEIL1_2",
                  .light = 160,
                  .tag = 900}};
  map.sidedefs = {{.sector = 0, .middle = "BRICK6"}};
  LinedefData line;
  line.blocking = true;
  map.linedefs = {line};
  map.things = {{.position = {1, -2}, .angle_degrees = 90, .editor_number = 9001, .id = 1000}};
  EXPECT_EQ(write_udmf(map),
            "namespace = \"zdoom\";\n\n"
            "thing\n{\nid = 1000;\nx = 1.000;\ny = -2.000;\nangle = 90;\ntype = 9001;\nskill1 = "
            "true;\nskill2 = true;\n"
            "skill3 = true;\nskill4 = true;\nskill5 = true;\nsingle = true;\ncoop = true;\ndm = true;\n}\n\n"
            "vertex\n{\nx = -16.000;\ny = 32.000;\n}\n\n"
            "linedef\n{\nv1 = 0;\nv2 = 0;\nsidefront = 0;\nblocking = true;\n}\n\n"
            "sidedef\n{\nsector = 0;\ntexturemiddle = \"BRICK6\";\n}\n\n"
            "sector\n{\nheightceiling = 384;\ntexturefloor = \"FLAT1\";\ntextureceiling = \"CEIL1_2\";\nid = "
            "900;\n}\n\n");
}

}  // namespace wad_writer_test
}  // namespace comrad::doomgen
