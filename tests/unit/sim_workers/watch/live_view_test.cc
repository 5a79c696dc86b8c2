#include "sim_workers/watch/live_view.h"

#include <gtest/gtest.h>

#include <functional>
#include <thread>
#include <vector>

#include "scenarios/spec/registry.h"
#include "sim_workers/env/doom_env.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/watch_page.h"

namespace comrad::sim {
namespace live_view_test {

using nlohmann::json;

constexpr int kFrameSkip = 4;

/// Lava Pit, played without a button in its own thread and shown tic by tic.
class LiveViewTest : public ::testing::Test {
 protected:
  void play(const std::string& first_commands) {
    const auto layout = scenarios::generate_layout("lava_pit", {});
    ASSERT_TRUE(layout) << layout.error().message;
    const EnvironmentOptions options{.scenario = "lava_pit",
                                     .layouts = {scratch_.write("map.wad", layout->wad)}};
    const auto library = LayoutLibrary::create(options);
    ASSERT_TRUE(library) << library.error().message;
    const auto game = (*library)->game(0);
    ASSERT_TRUE(game) << game.error().message;
    auto view = LiveView::create({.size = {128, 72}, .pictures_per_s = 1000}, options, **game,
                                 page_.connected(), [] { return false; });
    ASSERT_TRUE(view) << view.error().message;
    page_.say(first_commands);
    player_ = std::thread([game = *game, view = std::move(*view)] {
      DoomEnvironment environment(game);
      environment.show_to(view.get());
      environment.reset(1);
      const std::vector<int32_t> still(2 * game->spec.heads.size());
      while (!view->is_left() && !environment.last_step().episode_over()) environment.step(still);
    });
  }
  ~LiveViewTest() override {
    page_.leave();
    if (player_.joinable()) player_.join();
  }
  /// The first of the coming messages of type "now" that `is_it`.
  json now(const std::function<bool(const json&)>& is_it) {
    for (;;) {
      const json words = page_.words();
      if (words.is_null()) return {{"tic", -1}};
      if (words["type"] == "now" && is_it(words)) return words;
    }
  }
  int paused_at() {
    return now([](const json& words) { return words["pace"] == "paused"; })["tic"].get<int>();
  }

  const test::ScratchFolder scratch_;
  test::WatchPage page_;
  std::thread player_;
};

TEST_F(LiveViewTest, APageThatShowsPausedMovesNoMore) {
  ASSERT_NO_FATAL_FAILURE(play("{\"do\": \"shown\", \"pages\": 1}\n{\"do\": \"speed\", \"times\": 2}\n"));
  for (int round = 0; round < 2; ++round) {
    for (int phase = 0; phase < kFrameSkip; ++phase) {  // a decision is played to its end first
      now([&](const json& words) { return words["tic"].get<int>() % kFrameSkip == phase; });
      page_.say("{\"do\": \"pause\"}\n");
      const int paused = paused_at();
      ASSERT_EQ(paused % kFrameSkip, 0) << "the request came in tic " << phase << " of a decision";
      page_.say("{\"do\": \"step\"}\n");
      const json after = now([&](const json& words) { return words["tic"] == paused + kFrameSkip; });
      ASSERT_EQ(after["pace"], "paused") << "the step's end is shown at rest alone";
      page_.say("{\"do\": \"run\"}\n");
    }
  }
}

TEST_F(LiveViewTest, AnEpisodeThatBeginsWhilePausedWaits) {
  ASSERT_NO_FATAL_FAILURE(play("{\"do\": \"pause\"}\n{\"do\": \"shown\", \"pages\": 1}\n"));
  ASSERT_EQ(paused_at(), 0);
  page_.say("{\"do\": \"step\"}\n");
  ASSERT_EQ(paused_at(), kFrameSkip);
}

}  // namespace live_view_test
}  // namespace comrad::sim
