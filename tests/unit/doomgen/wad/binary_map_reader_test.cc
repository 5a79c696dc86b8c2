#include "doomgen/wad/binary_map_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/binary_map_bytes.h"
#include "tests/support/random_bytes.h"

namespace comrad::wad {
namespace binary_map_reader_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

Expected<UdmfMap> read(const test::WadBytes& bytes) {
  const WadFile wad = WadFile::from_bytes(bytes.build(), "b.wad").value();
  return read_binary_map(wad, wad.find_map("MAP01").value(), "b.wad: MAP01");
}

TEST(BinaryMap, ReadsDoomsFormat) {
  test::BinaryMapBytes bytes;
  bytes.linedefs[4].special = 97, bytes.linedefs[4].tag = 7;
  bytes.linedefs[5].flags |= 0x20 | 0x40 | 0x200;
  const UdmfMap map = read(bytes.doom()).value();
  EXPECT_TRUE(map.is_binary);
  ASSERT_THAT(map.vertices, SizeIs(8));
  EXPECT_EQ(map.vertices[3].x, 256);
  ASSERT_THAT(map.sectors, SizeIs(2));
  EXPECT_EQ(map.sectors[0].texture_floor, "FLOOR4_8");
  EXPECT_EQ(map.sectors[1].special, 0x400);
  EXPECT_EQ(map.sectors[1].id, 7);
  EXPECT_EQ(map.sidedefs[0].texture_middle, "SW1BRN1");
  ASSERT_THAT(map.linedefs, SizeIs(8));
  EXPECT_EQ(map.linedefs[0].side_back, -1);
  EXPECT_TRUE(map.linedefs[0].blocking);
  EXPECT_EQ(map.linedefs[4].special, 70);
  EXPECT_THAT(map.linedefs[4].args, ElementsAre(0, 7, 0, 0, 0));
  EXPECT_EQ(map.linedefs[4].id, 7);
  EXPECT_TRUE(map.linedefs[5].two_sided && map.linedefs[5].secret && map.linedefs[5].block_sound &&
              map.linedefs[5].pass_use);
  ASSERT_THAT(map.things, SizeIs(2));
  EXPECT_THAT(map.things[0].skill, ElementsAre(true, true, true, true, true, false, false, false));
  EXPECT_THAT(map.things[1].skill, ElementsAre(false, false, true, true, true, false, false, false));
  EXPECT_TRUE(map.things[1].ambush && !map.things[1].single && map.things[1].coop && map.things[1].dm);
  EXPECT_THAT(map.warnings, IsEmpty());
}

TEST(BinaryMap, ReadsHexensFormat) {
  test::BinaryMapBytes bytes;
  bytes.hexen_linedefs[0].special = 80, bytes.hexen_linedefs[0].args = {9, 0, 1, 2, 3};
  bytes.hexen_linedefs[0].flags |= 0x200 | 1 << 10;
  bytes.hexen_linedefs[1].special = 121, bytes.hexen_linedefs[1].args = {44, 0, 0, 0, 1};
  bytes.sectors[1].special = 83;
  const UdmfMap map = read(bytes.hexen()).value();
  EXPECT_EQ(map.linedefs[0].special, 80);
  EXPECT_THAT(map.linedefs[0].args, ElementsAre(9, 0, 1, 2, 3));
  EXPECT_TRUE(map.linedefs[0].player_use && map.linedefs[0].repeat_special && !map.linedefs[0].player_cross);
  EXPECT_EQ(map.linedefs[1].special, 0);
  EXPECT_EQ(map.linedefs[1].id, 44 + 256);
  EXPECT_EQ(map.sectors[1].special, 83);
  ASSERT_THAT(map.things, SizeIs(2));
  EXPECT_EQ(map.things[0].class_filter, 0xFFFFu);
  EXPECT_TRUE(map.things[0].single && map.things[0].coop && map.things[0].dm);
  EXPECT_EQ(map.things[1].id, 12);
  EXPECT_EQ(map.things[1].height, 24);
  EXPECT_EQ(map.things[1].special, 80);
  EXPECT_TRUE(map.things[1].dormant && map.things[1].skill[3] && !map.things[1].skill[2]);
}

TEST(BinaryMap, EachWayToActivateALineHasItsBits) {
  const auto activation = [](int bits) {
    test::BinaryMapBytes bytes;
    bytes.hexen_linedefs[0].special = 11;
    bytes.hexen_linedefs[0].flags = static_cast<uint16_t>(1 | bits << 10);
    return read(bytes.hexen()).value().linedefs[0];
  };
  EXPECT_TRUE(activation(0).player_cross);
  EXPECT_TRUE(activation(1).player_use);
  EXPECT_TRUE(activation(2).monster_cross && !activation(2).player_cross);
  EXPECT_TRUE(activation(3).impact);
  EXPECT_TRUE(activation(4).player_push);
  EXPECT_TRUE(activation(5).missile_cross);
  EXPECT_TRUE(activation(6).player_use && activation(6).pass_use);
}

TEST(BinaryMap, UnknownTypesAndMissingTagsAreOneWarningEach) {
  test::BinaryMapBytes bytes;
  bytes.linedefs[1].special = 5000, bytes.linedefs[2].special = 6000;
  bytes.linedefs[3].special = 2, bytes.linedefs[3].tag = 0;
  const UdmfMap map = read(bytes.doom()).value();
  ASSERT_THAT(map.warnings, SizeIs(2));
  EXPECT_THAT(map.warnings[0], HasSubstr("type 5000 of linedef 1"));
  EXPECT_THAT(map.warnings[1], HasSubstr("linedef 3"));
  EXPECT_EQ(map.linedefs[1].special, 0);
  EXPECT_EQ(map.linedefs[3].special, 0);
}

TEST(BinaryMap, RefusesMissingAndTruncatedLumps) {
  for (const char* name : {"THINGS", "LINEDEFS", "SIDEDEFS", "VERTEXES", "SECTORS"}) {
    test::WadBytes cut = test::BinaryMapBytes().doom();
    for (auto& [lump, bytes] : cut.lumps)
      if (lump == name) bytes.pop_back();
    const Expected<UdmfMap> map = read(cut);
    ASSERT_FALSE(map) << name;
    EXPECT_EQ(map.error().code, ErrorCode::kBadFormat);
    EXPECT_THAT(map.error().message, HasSubstr(std::string("b.wad: MAP01: ") + name));
    test::WadBytes without = test::BinaryMapBytes().doom();
    std::erase_if(without.lumps,
                  [&](const auto& lump) { return lump.first == name && lump.first != "THINGS"; });
    if (std::string_view(name) != "THINGS") {
      EXPECT_THAT(read(without).error().message, HasSubstr(std::string("has no ") + name));
    }
  }
}

}  // namespace binary_map_reader_test
}  // namespace comrad::wad
