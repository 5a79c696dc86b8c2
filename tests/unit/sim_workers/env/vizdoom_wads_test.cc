// Every WAD of ViZDoom's scenario folder: all maps load, their scripts run for 2 000 tics of random play
// without an error, and what is not served is named. Skipped where the Python package vizdoom is missing.
#include <gtest/gtest.h>

#include <filesystem>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "sim_workers/env/game_content.h"
#include "tests/support/vizdoom_python.h"

namespace comrad::sim {
namespace vizdoom_wads_test {

TEST(VizdoomWads, EveryMapRunsTwoThousandTicsOfRandomPlay) {
  const Expected<std::string> folder = test::vizdoom_scenario_folder();
  if (!folder) GTEST_SKIP() << folder.error().message;
  int maps = 0;
  std::vector<std::filesystem::path> wads;
  for (const auto& entry : std::filesystem::directory_iterator(*folder))
    if (entry.path().extension() == ".wad") wads.push_back(entry.path());
  std::sort(wads.begin(), wads.end());
  for (const auto& path : wads) {
    SCOPED_TRACE(path.filename().string());
    const auto wad = wad::WadFile::open(path.string());
    ASSERT_TRUE(wad.has_value()) << wad.error().message;
    for (int number = 1; number <= 5; ++number) {
      const std::string map = "MAP0" + std::to_string(number);
      if (!wad->find_map(map).has_value()) continue;
      const auto content = load_game_content(*wad, map);
      ASSERT_TRUE(content.has_value()) << content.error().message;
      EXPECT_TRUE(content->warnings.empty()) << testing::PrintToString(content->warnings);
      doom::World world(content->level, content->catalog, content->behavior);
      doom::WorldOptions options;
      options.player_count = number == 1 ? 2 : 1;
      options.start_at_deathmatch_starts = true, options.forced_respawn = true;
      options.seed = 5;
      reset_world(world, options);
      // Maps for deathmatch have no starts of players, but enough for a team.
      if (const std::string name = path.stem();
          number == 1 && (name.starts_with("cig") || name.starts_with("multi"))) {
        EXPECT_TRUE(world.body(0).x != world.body(1).x || world.body(0).y != world.body(1).y) << map;
      }
      Rng rng(uint64_t{11});
      std::vector<doom::Buttons> buttons(static_cast<std::size_t>(options.player_count));
      for (int tic = 0; tic < 2000; ++tic) {
        if (tic % 4 == 0)
          for (doom::Buttons& pressed : buttons) {
            const uint32_t bits = rng.below(1 << 12);
            pressed = {};
            pressed.forward = (bits & 1) != 0, pressed.backward = (bits & 14) == 2,
            pressed.left = (bits & 16) != 0;
            pressed.right = (bits & 32) != 0, pressed.turn_left = (bits & 64) != 0,
            pressed.turn_right = (bits & 128) != 0;
            pressed.attack = (bits & 256) != 0, pressed.use = (bits & 512) != 0,
            pressed.speed = (bits & 1024) != 0;
          }
        run_tic(world, buttons);
        if (world.level_exited()) reset_world(world, options);
      }
      EXPECT_EQ(world.state().scripts.last_error, "") << map;
      EXPECT_EQ(world.state().scripts.runaway_count, 0) << map;
      ++maps;
    }
  }
  EXPECT_GE(maps, 16);
}

}  // namespace vizdoom_wads_test
}  // namespace comrad::sim
