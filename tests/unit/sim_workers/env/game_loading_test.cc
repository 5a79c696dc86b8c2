#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/env/doom_env.h"

namespace comrad::sim {
namespace {

using testing::HasSubstr;

class GameLoading : public testing::Test {
 protected:
  void SetUp() override {
    path_ = testing::TempDir() + "/comrad_game_loading_" + std::to_string(getpid()) + ".wad";
    const auto layout = scenarios::generate_layout("coop_health_gathering", {.seed = 5});
    ASSERT_TRUE(layout) << layout.error().message;
    wad_ = layout->wad;
    write(wad_);
  }
  void TearDown() override { std::filesystem::remove(path_); }
  void write(const std::string& bytes) { ASSERT_TRUE(doomgen::write_file(path_, bytes)); }
  struct Wanted {
    std::string scenario = "coop_health_gathering";
    int num_agents = 2, frame_skip = 4;
  };
  Expected<std::shared_ptr<const DoomGame>> load(const Wanted& wanted) {
    EnvironmentOptions options;
    options.scenario = wanted.scenario;
    options.wad_path = path_;
    options.num_agents = wanted.num_agents;
    options.frame_skip = wanted.frame_skip;
    return load_doom_game(options);
  }
  std::string message(const Wanted& wanted) {
    const auto game = load(wanted);
    return game ? "no error" : game.error().message;
  }
  std::string path_, wad_;
};

TEST_F(GameLoading, ReadsScenarioLevelAndParameters) {
  const auto game = load({.num_agents = 3});
  ASSERT_TRUE(game) << game.error().message;
  EXPECT_EQ((*game)->num_agents, 3);
  EXPECT_EQ((*game)->layout.seed, 5u);
  EXPECT_EQ((*game)->layout.parameter("tether", 0), 400);
  EXPECT_EQ((*game)->level->sectors.size(), 1u);
  EXPECT_NE((*game)->rules, nullptr);
  EXPECT_TRUE((*game)->catalog->find("TetherHot"));
}

TEST_F(GameLoading, TheLayoutIdBelongsToTheContent) {
  const uint64_t first = (*load({}))->layout_id;
  EXPECT_EQ((*load({}))->layout_id, first);
  write(scenarios::generate_layout("coop_health_gathering", {.seed = 6})->wad);
  EXPECT_NE((*load({}))->layout_id, first);
}

TEST_F(GameLoading, BadRequestsSayWhatIsWrong) {
  EXPECT_THAT(message({.num_agents = 7}), HasSubstr("2, 3, 4"));
  EXPECT_THAT(message({.frame_skip = 0}), HasSubstr("env_frameskip"));
  EXPECT_THAT(message({.scenario = "coop_health"}), HasSubstr("coop_health_gathering"));
}

TEST_F(GameLoading, AMissingOrTruncatedWadIsAnErrorWithItsName) {
  write(wad_.substr(0, wad_.size() / 2));
  EXPECT_THAT(message({}), HasSubstr(path_));
  std::filesystem::remove(path_);
  EXPECT_THAT(message({}), HasSubstr(path_));
}

TEST_F(GameLoading, AMapOfAnotherScenarioIsRefused) {
  std::string other = wad_;
  other.replace(other.find("coop_health_gathering"), 21, "coop_health_gathexing");
  write(other);
  EXPECT_THAT(message({}), HasSubstr("is a map of scenario coop_health_gathexing"));
}

TEST_F(GameLoading, AMapWithoutEnoughStartsIsRefused) {
  write(scenarios::generate_layout("coop_health_gathering", {.parameters = {{"players", "2"}}})->wad);
  EXPECT_TRUE(load({}));
  EXPECT_THAT(message({.num_agents = 3}), HasSubstr("starts for 2 players"));
}

}  // namespace
}  // namespace comrad::sim
