#include "doomgen/wad/wad_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>

#include "tests/support/wad_bytes.h"

namespace comrad::wad {
namespace wad_reader_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

WadFile good(const test::WadBytes& wad) { return WadFile::from_bytes(wad.build(), "test.wad").value(); }

std::string message_of(std::vector<uint8_t> bytes) {
  Expected<WadFile> wad = WadFile::from_bytes(std::move(bytes), "test.wad");
  return wad ? "" : wad.error().message;
}

TEST(WadFile, GivesBackEveryLump) {
  const WadFile wad = good(test::WadBytes().add("FIRST", "abc").add("MARKER").add("EIGHTLET", "defg"));
  ASSERT_EQ(wad.lump_count(), 3u);
  EXPECT_EQ(wad.text(0), "abc");
  EXPECT_EQ(wad.text(1), "");
  EXPECT_EQ(wad.lump(2).name, "EIGHTLET");
  EXPECT_EQ(wad.text(2), "defg");
  EXPECT_FALSE(wad.is_iwad());
}

TEST(WadFile, TheLastLumpOfANameWinsInAnyCase) {
  const WadFile wad = good(test::WadBytes().add("SAME", "old").add("same", "new"));
  EXPECT_EQ(wad.find("Same"), 1u);
  EXPECT_EQ(wad.find("OTHER"), std::nullopt);
}

TEST(WadFile, AnEmptyWadIsFine) { EXPECT_EQ(good(test::WadBytes()).lump_count(), 0u); }

TEST(WadFile, JoinsTheLumpsBetweenMarkers) {
  const WadFile wad = good(test::WadBytes()
                               .add("S_START")
                               .add("AAAA", "1")
                               .add("S1_START")
                               .add("BBBB", "2")
                               .add("S_END")
                               .add("OUTSIDE", "3")
                               .add("SS_START")
                               .add("CCCC", "4")
                               .add("SS_END")
                               .add("S_START")
                               .add("NOEND", "5"));
  EXPECT_THAT(wad.lumps_between("S_START", "S_END"), ElementsAre(1, 3, 7));
  EXPECT_THAT(wad.lumps_between("F_START", "F_END"), IsEmpty());
}

TEST(WadFile, GroupsTheLumpsOfUdmfAndBinaryMaps) {
  const WadFile wad = good(test::WadBytes()
                               .add("MAP01")
                               .add("TEXTMAP", "x")
                               .add("BEHAVIOR", "acs")
                               .add("ENDMAP")
                               .add("E1M1")
                               .add("THINGS", "t")
                               .add("LINEDEFS")
                               .add("SECTORS")
                               .add("LAST", "l"));
  EXPECT_THAT(wad.map_names(), ElementsAre("MAP01", "E1M1"));
  const MapLumps udmf = wad.find_map("map01").value();
  EXPECT_EQ(udmf.textmap, 1u);
  EXPECT_EQ(udmf.behavior, 2u);
  EXPECT_EQ(udmf.end, 4u);
  const MapLumps binary = wad.find_map("E1M1").value();
  EXPECT_EQ(binary.textmap, std::nullopt);
  EXPECT_EQ(binary.end, 8u);
}

TEST(WadFile, NamesTheMapsThereAreWhenOneIsMissing) {
  const WadFile wad = good(test::WadBytes().add("MAP01").add("TEXTMAP", "x").add("ENDMAP"));
  const Expected<MapLumps> map = wad.find_map("MAP07");
  ASSERT_FALSE(map);
  EXPECT_EQ(map.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(map.error().message, HasSubstr("it has MAP01"));
}

TEST(WadFile, ATextmapWithoutEndIsAnError) {
  const WadFile wad = good(test::WadBytes().add("MAP01").add("TEXTMAP", "x"));
  EXPECT_EQ(wad.find_map("MAP01").error().code, ErrorCode::kBadFormat);
}

TEST(WadFile, RefusesWhatIsNoWad) {
  EXPECT_THAT(message_of({}), HasSubstr("shorter than a WAD header"));
  EXPECT_THAT(message_of(std::vector<uint8_t>(64, 'x')), HasSubstr("IWAD or PWAD"));
}

TEST(WadFile, EveryTruncationIsAnErrorOrKeepsInsideTheFile) {
  const std::vector<uint8_t> whole = test::WadBytes().add("FIRST", "abcdefgh").add("SECOND", "ijkl").build();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string message =
        message_of({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)});
    EXPECT_THAT(message, HasSubstr("test.wad")) << size << " bytes";
  }
}

TEST(WadFile, RefusesDirectoriesAndLumpsOutsideTheFile) {
  const auto bend = [](std::size_t at, int32_t value) {
    std::vector<uint8_t> bytes = test::WadBytes().add("LUMP", "abcd").build();
    std::memcpy(bytes.data() + at, &value, sizeof(value));
    return message_of(std::move(bytes));
  };
  EXPECT_THAT(bend(4, -1), HasSubstr("directory"));
  EXPECT_THAT(bend(4, INT32_MAX), HasSubstr("directory"));
  EXPECT_THAT(bend(8, -16), HasSubstr("directory"));
  EXPECT_THAT(bend(8, INT32_MAX), HasSubstr("directory"));
  const std::size_t directory = sizeof(WadHeaderRecord) + 4;
  EXPECT_THAT(bend(directory, -4), HasSubstr("'LUMP'"));
  EXPECT_THAT(bend(directory, INT32_MAX), HasSubstr("'LUMP'"));
  EXPECT_THAT(bend(directory + 4, -4), HasSubstr("'LUMP'"));
  EXPECT_THAT(bend(directory + 4, INT32_MAX), HasSubstr("'LUMP'"));
}

TEST(WadFile, OpensAFileAndReportsAMissingOne) {
  const std::string path = ::testing::TempDir() + "/comrad_wad_reader_test.wad";
  const std::vector<uint8_t> bytes = test::WadBytes().add("LUMP", "abcd").build();
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const WadFile wad = WadFile::open(path).value();
  const WadFile copy = wad;
  EXPECT_EQ(copy.text(0), "abcd");
  std::remove(path.c_str());
  const Expected<WadFile> missing = WadFile::open(path);
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(missing.error().message, HasSubstr(path));
  EXPECT_EQ(WadFile::open(::testing::TempDir()).error().code, ErrorCode::kBadInput);
}

}  // namespace wad_reader_test
}  // namespace comrad::wad
