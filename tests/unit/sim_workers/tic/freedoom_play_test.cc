// Every map of Freedoom 2, if it is installed, is played for 2 000 tics with its monsters and random buttons:
// nothing breaks, bodies stay in the map, the same run is the same at every tic.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "doomgen/wad/iwad_search.h"
#include "doomgen/wad/wad_reader.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {
namespace freedoom_play_test {

constexpr int kTics = 2'000;

const wad::WadFile* iwad() {
  static const auto kWad = [] {
    const auto path = wad::find_iwad();
    return path ? std::optional(wad::WadFile::open(*path)) : std::nullopt;
  }();
  return kWad && *kWad ? &**kWad : nullptr;
}

std::vector<Buttons> random_buttons(Rng& rng, std::vector<Buttons> held) {
  for (Buttons& hand : held) {
    if (rng.below(10) != 0) continue;
    hand = Buttons{};
    hand.forward = rng.below(4) != 0, hand.backward = rng.below(8) == 0;
    hand.left = rng.below(6) == 0, hand.right = rng.below(6) == 0;
    hand.turn_left = rng.below(4) == 0, hand.turn_right = rng.below(4) == 0;
    hand.speed = rng.below(2) == 0, hand.attack = rng.below(3) == 0, hand.use = rng.below(3) == 0;
    hand.jump = rng.below(8) == 0;
  }
  return held;
}

class FreedoomPlay : public ::testing::TestWithParam<int> {};

TEST_P(FreedoomPlay, TwoPlayersPlayTwoThousandTics) {
  if (iwad() == nullptr) GTEST_SKIP() << "freedoom2.wad is not installed (or name it by COMRAD_IWAD)";
  char name[8];
  std::snprintf(name, sizeof name, "MAP%02d", GetParam());
  const auto level = load_level(*iwad(), name);
  ASSERT_TRUE(level.has_value()) << level.error().message;
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  std::vector<uint64_t> first;
  for (int repeat = 0; repeat < 2; ++repeat) {
    World world(*level, kCatalog);
    reset_world(world, {.player_count = 2, .seed = 3, .skill = 4, .forced_respawn = true});
    EXPECT_GT(world.state().monster_count, 0);
    Rng rng(RngKey(9).split("freedoom"));
    std::vector<Buttons> held(2);
    for (int tic = 0; tic < kTics && !world.level_exited(); ++tic) {
      held = random_buttons(rng, held);
      run_tic(world, held);
      if (tic % 10 != 0) continue;
      const uint64_t hash = world.hash();
      if (repeat == 0) {
        first.push_back(hash);
      } else {
        ASSERT_EQ(hash, first[static_cast<std::size_t>(tic / 10)]) << "tic " << tic;
      }
    }
    for (int player = 0; player < 2; ++player) {
      const Actor& body = world.body(player);
      EXPECT_TRUE(world.index().outline.contains(body.x, body.y)) << "player " << player << " left the map";
      EXPECT_GE(body.z, body.floor_z);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(AllMaps, FreedoomPlay, ::testing::Range(1, 33));

}  // namespace freedoom_play_test
}  // namespace comrad::doom
