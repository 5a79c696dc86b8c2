// Hostile bytes: whatever comes in, the readers answer with a value or an error, and what they hand out lies
// inside the file. Repeat a failure with COMRAD_FUZZ_SEED=<seed>.
#include <gtest/gtest.h>

#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "tests/support/random_bytes.h"
#include "tests/support/wad_bytes.h"

namespace comrad::wad {
namespace wad_fuzz_test {

/// Touches every byte that a WAD hands out.
uint64_t read_all(const WadFile& wad) {
  uint64_t sum = 0;
  for (std::size_t index = 0; index < wad.lump_count(); ++index)
    for (uint8_t byte : wad.bytes(index)) sum += byte;
  for (const std::string& name : wad.map_names()) {
    const Expected<MapLumps> map = wad.find_map(name);
    if (map && map->textmap) sum += wad.bytes(*map->textmap).size();
  }
  return sum + wad.lumps_between("S_START", "S_END").size();
}

TEST(WadFuzz, RandomBytesNeverReachOutsideTheFile) {
  const uint64_t seed = comrad::test::fuzz_seed();
  SCOPED_TRACE("COMRAD_FUZZ_SEED=" + std::to_string(seed));
  Rng rng(seed);
  int accepted = 0;
  for (int round = 0; round < 20000; ++round) {
    std::vector<uint8_t> bytes = comrad::test::random_bytes(rng, rng.below(200));
    if (bytes.size() >= 12 && rng.below(2) == 0) {  // past the first check
      const char* magic = rng.below(2) == 0 ? "PWAD" : "IWAD";
      std::copy(magic, magic + 4, bytes.begin());
      for (std::size_t at : {5, 6, 7, 9, 10, 11}) bytes[at] = 0;
      bytes[4] &= 7;
    }
    if (const Expected<WadFile> wad = WadFile::from_bytes(std::move(bytes), "fuzz"))
      accepted += read_all(*wad) < UINT64_MAX;
  }
  EXPECT_GT(accepted, 0) << "the test should also get past the header";
}

TEST(WadFuzz, BentWadsNeverReachOutsideTheFile) {
  const uint64_t seed = comrad::test::fuzz_seed() + 1;
  SCOPED_TRACE("COMRAD_FUZZ_SEED=" + std::to_string(seed - 1));
  Rng rng(seed);
  const std::vector<uint8_t> whole = test::WadBytes()
                                         .add("S_START")
                                         .add("PLAYA1", "sprite")
                                         .add("S_END")
                                         .add("MAP01")
                                         .add("TEXTMAP", "vertex { x = 1; y = 2; }")
                                         .add("ENDMAP")
                                         .build();
  int accepted = 0;
  for (int round = 0; round < 20000; ++round)
    if (const Expected<WadFile> wad = WadFile::from_bytes(comrad::test::mutated(rng, whole), "fuzz"))
      accepted += read_all(*wad) < UINT64_MAX;
  EXPECT_GT(accepted, 0);
}

TEST(UdmfFuzz, BentTextGivesAMapOrAnErrorWithItsPlace) {
  const uint64_t seed = comrad::test::fuzz_seed() + 2;
  SCOPED_TRACE("COMRAD_FUZZ_SEED=" + std::to_string(seed - 2));
  Rng rng(seed);
  const std::string whole = test::square_room_text();
  int accepted = 0, refused = 0;
  for (int round = 0; round < 5000; ++round) {
    const std::string text = comrad::test::mutated(rng, whole);
    const Expected<UdmfMap> map = parse_udmf(text, "fuzz");
    if (map) {
      ++accepted;
    } else {
      ++refused;
      EXPECT_EQ(map.error().code, ErrorCode::kBadFormat);
      EXPECT_EQ(map.error().message.rfind("fuzz:", 0), 0u) << map.error().message;
    }
  }
  EXPECT_GT(accepted, 0);
  EXPECT_GT(refused, 0);
}

TEST(UdmfFuzz, RandomBytesEnd) {
  const uint64_t seed = comrad::test::fuzz_seed() + 3;
  SCOPED_TRACE("COMRAD_FUZZ_SEED=" + std::to_string(seed - 3));
  Rng rng(seed);
  for (int round = 0; round < 20000; ++round) {
    const std::vector<uint8_t> bytes = comrad::test::random_bytes(rng, rng.below(100));
    const Expected<UdmfMap> map =
        parse_udmf({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, "fuzz");
    EXPECT_TRUE(!map || map->vertices.empty());
  }
}

}  // namespace wad_fuzz_test
}  // namespace comrad::wad
