// Environments that play a pool: a layout chosen in mid-life is the same game as one that was there from
// the beginning.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "scenarios/spec/layout_pool.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/oracle/oracle.h"

namespace comrad::sim {
namespace layout_library_test {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Layouts : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) / ("comrad_layouts_" + std::to_string(getpid()));
    const auto pool = scenarios::make_pool("coop_health_gathering", {.count = 3}, folder_.string());
    ASSERT_TRUE(pool) << pool.error().message;
    for (const scenarios::PoolEntry& entry : *pool)
      options_.layouts.push_back((folder_ / entry.filename).string());
    options_.scenario = "coop_health_gathering";
    options_.count = 2;
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// The same game alone.
  std::unique_ptr<DoomEnvironment> alone(int layout) const {
    EnvironmentOptions options = options_;
    options.layouts.clear();
    options.wad_path = options_.layouts[static_cast<std::size_t>(layout)];
    auto game = load_doom_game(options);
    EXPECT_TRUE(game) << game.error().message;
    return std::make_unique<DoomEnvironment>(*game);
  }
  /// Plays and gives the hash after some decisions.
  static uint64_t play(Environment& environment, uint64_t seed) {
    environment.reset(seed);
    for (int step = 0; step < 40; ++step) environment.step(std::vector<int32_t>{1, step % 3, 0, 2, 1, 1});
    return environment.state_hash();
  }

  fs::path folder_;
  EnvironmentOptions options_;
};

TEST_F(Layouts, AChosenLayoutIsTheSameGameAsItAlone) {
  auto library = LayoutLibrary::create(options_);
  ASSERT_TRUE(library) << library.error().message;
  DoomEnvironment environment(*(*library)->game(0));
  environment.choose_from(*library);
  std::set<uint64_t> ids;
  for (const int layout : {0, 2, 1, 2, 0}) {
    ASSERT_TRUE(environment.choose_layout(layout));
    const auto reference = alone(layout);
    EXPECT_EQ(environment.layout_id(), reference->layout_id());
    EXPECT_EQ(play(environment, 5), play(*reference, 5)) << "layout " << layout;
    ids.insert(environment.layout_id());
  }
  EXPECT_EQ(ids.size(), 3u);
}

TEST_F(Layouts, WhatCannotBePlayedIsAnErrorThatNamesIt) {
  auto library = LayoutLibrary::create(options_);
  ASSERT_TRUE(library);
  EXPECT_THAT((*library)->game(3).error().message, HasSubstr("the pool has 3"));
  fs::remove(options_.layouts[1]);
  EXPECT_THAT((*library)->game(1).error().message,
              HasSubstr(fs::path(options_.layouts[1]).filename().string()));
  std::ofstream(options_.layouts[2]) << "no WAD";
  EXPECT_FALSE((*library)->game(2));
  EXPECT_TRUE((*library)->game(0)) << "what is loaded stays";
  const auto single = alone(0);
  EXPECT_TRUE(single->choose_layout(0));
  EXPECT_FALSE(single->choose_layout(1)) << "one map has no second";
}

TEST_F(Layouts, ManyMoreThanAreKeptComeAndGo) {
  const auto three = options_.layouts;
  for (std::size_t i = 3; i < LayoutLibrary::kGamesKept + 20; ++i) options_.layouts.push_back(three[i % 3]);
  auto library = LayoutLibrary::create(options_);
  ASSERT_TRUE(library);
  const auto first = *(*library)->game(0);
  const std::weak_ptr<const DoomGame> second = *(*library)->game(1);
  for (int layout = 0; layout < (*library)->size(); ++layout) {
    ASSERT_TRUE((*library)->game(layout));
    ASSERT_EQ((*library)->game(0)->get(), first.get()) << "a requested game stays";
  }
  EXPECT_TRUE(second.expired()) << "others are dropped";
}

TEST_F(Layouts, TheScriptedTeamIsMadeForTheLayoutThatItPlays) {
  auto library = LayoutLibrary::create(options_);
  ASSERT_TRUE(library);
  for (int layout = 0; layout < 3; ++layout)
    EXPECT_TRUE(play_oracle_episode(*(*library)->game(layout), 3)) << layout;
}

/// With the real renderer: pictures of a chosen layout are those of a set that plays it alone.
TEST_F(Layouts, ItsPicturesAreThoseOfItAlone) {
  auto pool = make_doom_environments(options_);
  if (!pool && (pool.error().code == ErrorCode::kUnsupported || pool.error().code == ErrorCode::kNotFound))
    GTEST_SKIP() << pool.error().message;
  ASSERT_TRUE(pool) << pool.error().message;
  EnvironmentOptions one = options_;
  one.layouts.clear();
  one.wad_path = options_.layouts[2];
  auto alone = make_doom_environments(one);
  ASSERT_TRUE(alone) << alone.error().message;
  const EnvShape& shape = (*pool)->at(0).shape();
  const auto picture = [&](EnvironmentSet& set, int index) {
    std::vector<uint8_t> frame(static_cast<std::size_t>(shape.num_agents * shape.frame_bytes()));
    const ObservationTarget target{.frame = frame.data()};
    set.observe(std::span(&index, 1), std::span(&target, 1));
    return frame;
  };
  (*pool)->at(0).reset(9);
  (*pool)->at(1).reset(9);
  const auto before = picture(**pool, 1);
  ASSERT_TRUE((*pool)->at(1).choose_layout(2));
  (*pool)->at(1).reset(9);
  (*alone)->at(0).reset(9);
  EXPECT_EQ(picture(**pool, 1), picture(**alone, 0));
  EXPECT_NE(picture(**pool, 1), before);
  EXPECT_EQ(picture(**pool, 0), before) << "its neighbour plays the layout that it played";
}

}  // namespace layout_library_test
}  // namespace comrad::sim
