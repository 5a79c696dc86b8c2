#include "sim_workers/engine/map/level_loader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim_workers/engine/map/level_index.h"
#include "tests/support/wad_bytes.h"

namespace comrad::doom {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

wad::WadFile wad_with(const std::string& textmap) {
  return wad::WadFile::from_bytes(
             wad::test::WadBytes().add("MAP01").add("TEXTMAP", textmap).add("ENDMAP").build(), "t.wad")
      .value();
}

/// The message for the square room with `from` replaced by `to`.
std::string message_with(const std::string& from, const std::string& to) {
  std::string text = wad::test::square_room_text();
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  const Expected<std::shared_ptr<const Level>> level = load_level(wad_with(text));
  return level ? "" : level.error().message;
}

TEST(LevelLoader, MakesALevelFromText) {
  const std::shared_ptr<const Level> level =
      load_level(wad_with(wad::test::square_room_text()), "map01").value();
  EXPECT_EQ(level->name, "MAP01");
  ASSERT_THAT(level->linedefs, SizeIs(4));
  EXPECT_EQ(level->linedefs[0].flags, kLineBlocking);
  EXPECT_FALSE(level->linedefs[0].back.has_value());
  EXPECT_EQ(level->vertices[2].x, to_fixed(256));
  EXPECT_EQ(level->sectors[0].tag, 900);
  EXPECT_EQ(level->sectors[0].floor_texture, "FLAT1");
  EXPECT_EQ(level->sectors[0].ceiling_height, to_fixed(128));
  ASSERT_THAT(level->things, SizeIs(2));
  EXPECT_EQ(level->things[1].x, to_fixed(64) + kFracUnit / 2);
  EXPECT_EQ(level->things[1].flags, uint32_t{kThingSkill1 << 2 | kThingSingle | kThingCoop});
  EXPECT_THAT(level->sector_linedefs[0], SizeIs(4));
  ASSERT_NE(level->index, nullptr);
  EXPECT_THAT(level->index->blockmap.lines(), SizeIs(4));
}

TEST(LevelLoader, ChecksEveryIndex) {
  EXPECT_THAT(message_with("v1 = 0;", "v1 = 4;"),
              HasSubstr("TEXTMAP of MAP01:8: linedef from vertex 4, but there are 4"));
  EXPECT_THAT(message_with("v2 = 1;", "v2 = -1;"), HasSubstr("linedef to vertex -1"));
  EXPECT_THAT(message_with("sidefront = 0;", "sidefront = 4;"), HasSubstr("sidefront 4"));
  EXPECT_THAT(message_with("sidefront = 0;", "sidefront = 0; sideback = -2;"), HasSubstr("sideback -2"));
  EXPECT_THAT(message_with("sector = 0;", "sector = 1;"), HasSubstr("sidedef of sector 1"));
}

TEST(LevelLoader, RefusesDegenerateAndHugeGeometry) {
  EXPECT_THAT(message_with("v2 = 1;", "v2 = 0;"), HasSubstr("no length"));
  EXPECT_THAT(message_with("x = -256.0;", "x = 40000.0;"), HasSubstr("outside"));
  EXPECT_THAT(message_with("x = -256.0;", "x = -31999.0;"), HasSubstr("longer"));
  EXPECT_THAT(message_with("heightceiling = 128;", "heightceiling = -1;"), HasSubstr("below its floor"));
  EXPECT_THAT(message_with("heightceiling = 128;", "heightceiling = 1e9;"), HasSubstr("outside"));
  EXPECT_THAT(message_with("x = 64.5;", "x = 1e30;"), HasSubstr("thing at x"));
  EXPECT_THAT(message_with("sidefront = 0;", "sidefront = 0; twosided = true;"), HasSubstr("no sideback"));
}

TEST(LevelLoader, RefusesOtherNamespacesAndFormats) {
  EXPECT_THAT(message_with("\"zdoom\"", "\"doom\""), HasSubstr("namespace \"doom\""));
  const wad::WadFile binary =
      wad::WadFile::from_bytes(wad::test::WadBytes().add("MAP01").add("THINGS").add("LINEDEFS").build(),
                               "b.wad")
          .value();
  EXPECT_EQ(load_level(binary).error().code, ErrorCode::kUnsupported);
  const wad::WadFile empty = wad::WadFile::from_bytes(wad::test::WadBytes().build(), "e.wad").value();
  EXPECT_EQ(load_level(empty).error().code, ErrorCode::kNotFound);
  EXPECT_THAT(load_level(wad_with("namespace = \"zdoom\";")).error().message, HasSubstr("without sectors"));
}

}  // namespace
}  // namespace comrad::doom
