// Bent maps: the loader refuses them or makes a level in which a world can be played. Repeat a failure
// with COMRAD_FUZZ_SEED=<seed>.
#include <gtest/gtest.h>

#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/binary_map_bytes.h"
#include "tests/support/random_bytes.h"
#include "tests/support/wad_bytes.h"

namespace comrad::doom {
namespace level_fuzz_test {

TEST(LevelFuzz, EveryAcceptedMapCanBePlayed) {
  const uint64_t seed = comrad::test::fuzz_seed();
  SCOPED_TRACE("COMRAD_FUZZ_SEED=" + std::to_string(seed));
  Rng rng(seed);
  const auto catalog = std::make_shared<const ActorCatalog>();
  const std::string whole = wad::test::square_room_text();
  int played = 0, refused = 0;
  for (int round = 0; round < 4000; ++round) {
    const std::string text = comrad::test::mutated(rng, whole);
    const Expected<wad::UdmfMap> map = wad::parse_udmf(text, "fuzz");
    if (!map) continue;
    const Expected<std::shared_ptr<const Level>> level = make_level(*map, "MAP01", "fuzz");
    if (!level) {
      ++refused;
      EXPECT_EQ(level.error().message.rfind("fuzz", 0), 0u);
      continue;
    }
    World world(*level, catalog);
    reset_world(world, {.player_count = 2});
    std::array<Buttons, 2> buttons;
    buttons[0].forward = buttons[0].speed = buttons[1].left = true;
    for (int tic = 0; tic < 35; ++tic) run_tic(world, buttons);
    ++played;
  }
  EXPECT_GT(played, 0);
  EXPECT_GT(refused, 0);
}

TEST(LevelFuzz, EveryAcceptedBinaryMapCanBePlayed) {
  const uint64_t seed = comrad::test::fuzz_seed() + 1;
  SCOPED_TRACE("COMRAD_FUZZ_SEED=" + std::to_string(seed - 1));
  Rng rng(seed);
  const auto catalog = std::make_shared<const ActorCatalog>();
  int played = 0, refused = 0;
  for (int round = 0; round < 3000; ++round) {
    wad::test::WadBytes bytes =
        rng.below(2) == 0 ? wad::test::BinaryMapBytes().doom() : wad::test::BinaryMapBytes().hexen();
    for (int change = rng.between(1, 6); change > 0; --change) {
      std::string& lump = bytes.lumps[rng.below(static_cast<uint32_t>(bytes.lumps.size()))].second;
      if (!lump.empty()) lump[rng.below(static_cast<uint32_t>(lump.size()))] = static_cast<char>(rng.next());
    }
    const auto wad = wad::WadFile::from_bytes(bytes.build(), "fuzz.wad").value();
    const auto level = load_level(wad);
    if (!level) {
      ++refused;
      EXPECT_EQ(level.error().message.rfind("fuzz.wad", 0), 0u);
      continue;
    }
    World world(*level, catalog);
    reset_world(world, {.player_count = 1});
    std::array<Buttons, 1> buttons;
    buttons[0].forward = buttons[0].speed = true;
    for (int tic = 0; tic < 35; ++tic) {
      buttons[0].use = tic % 2 == 0;
      run_tic(world, buttons);
    }
    ++played;
  }
  EXPECT_GT(played, 0);
  EXPECT_GT(refused, 0);
}

}  // namespace level_fuzz_test
}  // namespace comrad::doom
