#include "sim_workers/engine/map/level_loader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim_workers/engine/map/level_index.h"
#include "tests/support/binary_map_bytes.h"
#include "tests/support/wad_bytes.h"

namespace comrad::doom {
namespace level_loader_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
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
  EXPECT_THAT(message_with("heightceiling = 128;", "heightceiling = 1e9;"), HasSubstr("outside"));
  EXPECT_THAT(message_with("x = 64.5;", "x = 1e30;"), HasSubstr("thing at x"));
}

TEST(LevelLoader, RefusesOtherNamespacesAndEmptyMaps) {
  EXPECT_THAT(message_with("\"zdoom\"", "\"doom\""), HasSubstr("namespace \"doom\""));
  const wad::WadFile empty = wad::WadFile::from_bytes(wad::test::WadBytes().build(), "e.wad").value();
  EXPECT_EQ(load_level(empty).error().code, ErrorCode::kNotFound);
  EXPECT_THAT(load_level(wad_with("namespace = \"zdoom\";")).error().message, HasSubstr("without sectors"));
}

// Probe in ViZDoom 1.3.2: line type 58 (raise a tagged floor by 24) in namespace ZDoomTranslated moves the floor of sector
// 5 with arg0 = 5 and does nothing with id = 5; sector type 7 costs 5 health.
TEST(LevelLoader, TheTranslatedNamespaceHasDoomsNumbers) {
  std::string text = wad::test::square_room_text();
  const auto put = [&text](const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
  };
  put("\"zdoom\"", "\"ZDoomTranslated\"");
  put("sidefront = 0; blocking = true;", "sidefront = 0; blocking = true; special = 58; arg0 = 5;");
  put("sidefront = 1; blocking = true;", "sidefront = 1; blocking = true; special = 58; id = 5;");
  put("sidefront = 2; blocking = true;", "sidefront = 2; blocking = true; special = 52;");
  put("sidefront = 3; blocking = true;", "sidefront = 3; blocking = true; special = 9999;");
  put("lightlevel = 200;", "lightlevel = 200; special = 7;");
  const auto level = load_level(wad_with(text));
  ASSERT_TRUE(level) << level.error().message;
  constexpr int kRaiseByValue = 23, kExitNormal = 243, kNukage = 64 + 7;
  const std::vector<Linedef>& lines = (*level)->linedefs;
  EXPECT_EQ(lines[0].special, kRaiseByValue);
  EXPECT_EQ(lines[0].args[0], 5);
  EXPECT_EQ(lines[0].args[2], 24);
  EXPECT_EQ(lines[1].special, 0) << "no tag";
  EXPECT_EQ(lines[2].special, kExitNormal);
  EXPECT_EQ(lines[3].special, 0);
  EXPECT_EQ((*level)->sectors[0].special, kNukage);
  EXPECT_THAT((*level)->warnings, testing::Contains(HasSubstr("1 linedefs of types that are not known")));
}

// ---------------------------------------------------------------- binary formats

std::shared_ptr<const Level> level_of(const wad::test::WadBytes& bytes) {
  return load_level(wad::WadFile::from_bytes(bytes.build(), "b.wad").value()).value();
}

TEST(LevelLoader, MakesTheSameLevelFromDoomsAndHexensFormat) {
  const wad::test::BinaryMapBytes bytes;
  const std::shared_ptr<const Level> doom = level_of(bytes.doom()), hexen = level_of(bytes.hexen());
  EXPECT_EQ(doom->format, MapFormat::kDoom);
  EXPECT_EQ(hexen->format, MapFormat::kHexen);
  for (const auto& level : {doom, hexen}) {
    ASSERT_THAT(level->linedefs, SizeIs(8));
    EXPECT_EQ(level->linedefs[0].flags, kLineBlocking);
    EXPECT_EQ(level->linedefs[4].flags, kLineTwoSided);
    EXPECT_EQ(level->index->sectors.sector_at(0, 0), 1u);
    EXPECT_EQ(level->index->sectors.sector_at(to_fixed(100), 0), 0u);
    EXPECT_EQ(level->sectors[1].floor_height, to_fixed(16));
    EXPECT_THAT(level->warnings, IsEmpty());
  }
  EXPECT_EQ(doom->sectors[1].special, 0x400);
  EXPECT_EQ(hexen->things[1].args, (std::array<int32_t, 5>{3, 0, 1, 2, 3}));
}

TEST(LevelLoader, HandsOutTheLastBehaviorAndTheOtherLumpsOfScripts) {
  const std::shared_ptr<const Level> hexen = level_of(wad::test::BinaryMapBytes().hexen());
  EXPECT_EQ(std::string(hexen->behavior_lump.begin(), hexen->behavior_lump.end()), "ACS last");
  EXPECT_EQ(hexen->scripts_text, "script 1 OPEN {}");
  const std::shared_ptr<const Level> udmf = level_of(wad::test::WadBytes()
                                                         .add("MAP01")
                                                         .add("TEXTMAP", wad::test::square_room_text())
                                                         .add("BEHAVIOR", "old")
                                                         .add("DIALOGUE", "d")
                                                         .add("ZNODES", "n")
                                                         .add("BEHAVIOR", "new")
                                                         .add("SCRIPTS", "s")
                                                         .add("ENDMAP")
                                                         .add("BEHAVIOR", "of no map"));
  EXPECT_EQ(udmf->format, MapFormat::kUdmf);
  EXPECT_EQ(std::string(udmf->behavior_lump.begin(), udmf->behavior_lump.end()), "new");
  EXPECT_EQ(udmf->scripts_text, "s");
  EXPECT_EQ(udmf->dialogue_text, "d");
}

TEST(LevelLoader, PutsRightWhatSloppyBinaryMapsGetWrong) {
  wad::test::BinaryMapBytes bytes;
  bytes.linedefs.push_back({2, 2, 1, 0, 0, 0, wad::kNoSidedef});                // no length
  bytes.linedefs.push_back({0, 2, 1, 0, 0, wad::kNoSidedef, wad::kNoSidedef});  // no side
  bytes.linedefs[0].flags |= 4;                                                 // two-sided without a back
  bytes.linedefs[1].front = 0;                                                  // shares a side
  bytes.sectors[1].ceiling_height = 8;                                          // below its floor
  const std::shared_ptr<const Level> level = level_of(bytes.doom());
  ASSERT_THAT(level->linedefs, SizeIs(8));
  EXPECT_THAT(level->warnings, SizeIs(4));
  EXPECT_THAT(level->warnings, Contains(HasSubstr("1 linedefs of no length, left out, linedef 8 the first")));
  EXPECT_EQ(level->linedefs[0].flags & kLineTwoSided, 0u);
  EXPECT_NE(level->linedefs[0].front, level->linedefs[1].front);
  EXPECT_EQ(level->sidedefs[level->linedefs[1].front].middle,
            level->sidedefs[level->linedefs[0].front].middle);
  EXPECT_EQ(level->sectors[1].ceiling_height, level->sectors[1].floor_height);
}

TEST(LevelLoader, ChecksTheIndicesOfBinaryMaps) {
  wad::test::BinaryMapBytes bytes;
  bytes.linedefs[3].start = 900;
  const auto level = load_level(wad::WadFile::from_bytes(bytes.doom().build(), "b.wad").value());
  ASSERT_FALSE(level);
  EXPECT_THAT(level.error().message, HasSubstr("b.wad: map MAP01: linedef 3: linedef from vertex 900"));
}

TEST(LevelLoader, NamesWhatItDoesNotSupport) {
  wad::test::BinaryMapBytes bytes;
  bytes.linedefs[4].special = 242, bytes.linedefs[4].tag = 1;
  EXPECT_THAT(level_of(bytes.doom())->warnings,
              ElementsAre(HasSubstr("Transfer_Heights (209) on 1 linedefs")));
}

TEST(LevelLoader, AShutSectorAndFieldsThatAreNotKnownAreWarningsOfTheirNames) {
  std::string text = wad::test::square_room_text();
  const auto replace = [&text](const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
  };
  replace("heightceiling = 128;", "heightceiling = -1; soundsequence = \"x\"; comment = \"a note\";");
  replace("x = 64.5;", "x = 64.5; conversation = 3; user_mine = 1;");
  const auto level = load_level(wad_with(text));
  ASSERT_TRUE(level) << level.error().message;
  EXPECT_THAT((*level)->warnings,
              ElementsAre(HasSubstr("'sector soundsequence'"), HasSubstr("'thing conversation'"),
                          HasSubstr("ceiling below their floor")));
}

TEST(LevelLoader, LinesOfPolyobjectsAreNoWallsWhereTheyWereDrawn) {
  wad::test::BinaryMapBytes bytes;
  bytes.hexen_linedefs[4].special = 1, bytes.hexen_linedefs[4].args = {3, 0, 0, 0, 0};
  const std::shared_ptr<const Level> level = level_of(bytes.hexen());
  for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(level->linedefs[i].in_polyobject, i >= 4) << i;
  EXPECT_EQ(level->index->sectors.sector_at(0, 0), 0u);
  int near = 0;
  level->index->blockmap.for_each_line(Box::around(0, 0, to_fixed(80)),
                                       [&](const BlockLine&) { return ++near > 0; });
  EXPECT_EQ(near, 0);
}

TEST(LevelLoader, TranslucentLinesAreFoundByTheirId) {
  wad::test::BinaryMapBytes bytes;
  bytes.linedefs[4].special = 260, bytes.linedefs[4].tag = 9;
  bytes.linedefs[6].tag = 9;
  const std::shared_ptr<const Level> level = level_of(bytes.doom());
  EXPECT_FLOAT_EQ(level->linedefs[4].alpha, 168.0f / 255.0f);
  EXPECT_FLOAT_EQ(level->linedefs[6].alpha, 168.0f / 255.0f);
  EXPECT_FLOAT_EQ(level->linedefs[5].alpha, 1.0f);
}

TEST(LevelLoader, ReadsTheDecorationsOfUdmf) {
  std::string text = wad::test::square_room_text();
  const auto put = [&](const std::string& before, const std::string& more) {
    text.insert(text.find(before) + before.size(), more);
  };
  put("v1 = 0; v2 = 1;", " blocksight = true; playeruse = true; monsteractivate = true; alpha = 7.0;");
  put("texturefloor = \"flat1\";",
      " lightcolor = 255; damageamount = 20; damagetype = \"fire\"; yscalefloor = 0.5;");
  put("type = 2011;", " skill8 = true; ambush = true; friend = true; alpha = 0.5; health = 2;");
  put("texturemiddle = \"brick6\";", " offsetx_mid = -3.5; wrapmidtex = true;");
  const std::shared_ptr<const Level> level = load_level(wad_with(text)).value();
  EXPECT_EQ(level->linedefs[0].flags,
            uint32_t{kLineBlocking | kLineBlockSight | kLinePlayerUse | kLineMonsterActivate});
  EXPECT_FLOAT_EQ(level->linedefs[0].alpha, 1.0f);
  EXPECT_EQ(level->sectors[0].light_color, 255u);
  EXPECT_EQ(level->sectors[0].damage_amount, 20);
  EXPECT_FLOAT_EQ(level->sectors[0].floor_placement.scale_y, 0.5f);
  EXPECT_EQ(level->sidedefs[0].parts[kSideMiddle].offset_x, -to_fixed(7) / 2);
  EXPECT_EQ(level->sidedefs[0].flags, uint32_t{kSideWrapMiddle});
  EXPECT_EQ(level->things[1].flags & ~uint32_t{kThingSkill1 << 2 | kThingSingle | kThingCoop},
            thing_skill_flag(8) | kThingAmbush | kThingFriend);
  EXPECT_FLOAT_EQ(level->things[1].alpha, 0.5f);
  EXPECT_EQ(level->things[1].health, 2);
}

}  // namespace level_loader_test
}  // namespace comrad::doom
