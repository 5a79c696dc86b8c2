#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>

#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "rollout_buffer/core/files.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/env/doom_env.h"
#include "tests/support/scratch_folder.h"

namespace comrad::sim {
namespace game_loading_test {

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
  void write(const std::string& bytes) {
    ASSERT_TRUE(write_file_atomically(path_, bytes, /*durable=*/false));
  }
  struct Wanted {
    std::string scenario = "coop_health_gathering";
    int num_agents = 2, frame_skip = 4;
    std::string reward = {};
  };
  Expected<std::shared_ptr<const DoomGame>> load(const Wanted& wanted) {
    EnvironmentOptions options;
    options.scenario = wanted.scenario;
    options.wad_path = path_;
    options.num_agents = wanted.num_agents;
    options.frame_skip = wanted.frame_skip;
    options.reward = wanted.reward;
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
  EXPECT_NE((*game)->behavior, nullptr);
  EXPECT_TRUE((*game)->catalog->find("TetherHot"));
}

TEST_F(GameLoading, TakesOtherWeightsForRewards) {
  const auto game = load({.reward = "own_death=-7,kit_taken=0"});
  ASSERT_TRUE(game) << game.error().message;
  std::map<std::string, double> weights;
  for (const scenarios::RewardTerm& term : (*game)->spec.rewards) weights[term.name] = term.weight.last();
  EXPECT_EQ(weights["own_death"], -7);
  EXPECT_EQ(weights["kit_taken"], 0);
  EXPECT_EQ(weights["health_gained"], 0.1);
  EXPECT_THAT(message({.reward = "own_deth=-7"}), HasSubstr("did you mean 'own_death'"));
}

TEST_F(GameLoading, AScenarioWithABasePlaysTheBasesMap) {
  const test::ScratchFolder folder;
  folder.write("gentle/scenario.toml",
               "name = \"gentle\"\nbase = \"coop_health_gathering\"\nceiling = 900\n");
  const auto game = load({.scenario = (folder / "gentle").string()});
  ASSERT_TRUE(game) << game.error().message;
  EXPECT_EQ((*game)->spec.name, "gentle");
  EXPECT_EQ((*game)->ceiling, 900);
  EXPECT_EQ((*load({}))->layout_id, (*game)->layout_id);
  folder.write("gentle/scenario.toml", "name = \"gentle\"\nbase = \"lava_pit\"\n");
  EXPECT_THAT(message({.scenario = (folder / "gentle").string()}),
              HasSubstr("is a map of scenario coop_health_gathering, not of lava_pit"));
}

TEST_F(GameLoading, MistakesAreSaidOfTheFilesThatTheirAuthorEdits) {
  const test::ScratchFolder folder;
  const std::string actors = "actor Lamp {\n  Health fourty\n}\n";
  const auto load_with = [&](const std::string& decorate) {
    doomgen::MapPlan plan;
    plan.add_area({.name = "hall"}, doomgen::Box{{0, 0}, {512, 512}});
    plan.add_start(1, {100, 100}, 0);
    plan.add_start(2, {100, 300}, 0);
    doomgen::WadWriter wad;
    EXPECT_TRUE(wad.add("DECORATE", decorate));
    EXPECT_TRUE(wad.add_udmf_map("MAP01", doomgen::write_udmf(*plan.build())));
    write(*wad.bytes());
    folder.write("mine/mine.wad", *wad.bytes());
    return message({.scenario = (folder / "mine").string()});
  };
  folder.write(
      "mine/scenario.toml",
      "name = \"mine\"\ntitle = \"Mine\"\nsummary = \"Mine.\"\ndifficulty = 1\ndefault_agents = 2\n"
      "supported_agents = [2]\ndecision_limit = 10\nscore = \"return\"\nceiling = 1\nwad = \"mine.wad\"\n"
      "[[heads]]\nbuttons = [\"MOVE_FORWARD\"]\n");
  EXPECT_THAT(load_with(actors), testing::StartsWith((folder / "mine/mine.wad").string() + " DECORATE:2"));
  folder.write("mine/actors.decorate", actors);
  EXPECT_THAT(load_with(actors), testing::StartsWith((folder / "mine/actors.decorate").string() + ":2"));
  const std::string other = load_with(actors + "// another text\n");
  EXPECT_THAT(other, testing::StartsWith((folder / "mine/mine.wad").string() + " DECORATE:2"));
  folder.write("mine/mine.wad", "edited since");
  EXPECT_THAT(message({.scenario = (folder / "mine").string()}), testing::StartsWith(path_))
      << "then the copy is another file";
}

/// A fourteenth scenario, from a folder with a WAD and a scenario.toml alone: it loads, plays, pays and ends.
TEST_F(GameLoading, AScenarioOfSomebodysOwnPlaysWithoutCode) {
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("comrad_walk_" + std::to_string(getpid()));
  const std::string name = folder.filename();
  std::filesystem::create_directories(folder);
  doomgen::MapPlan plan;
  plan.add_area({.name = "hall"}, doomgen::Box{{0, 0}, {2048, 512}});
  plan.add_start(1, {100, 100}, 0);
  plan.add_start(2, {100, 300}, 0);
  doomgen::WadWriter wad;
  ASSERT_TRUE(wad.add_udmf_map("MAP01", doomgen::write_udmf(*plan.build())));
  ASSERT_TRUE(write_file_atomically((folder / "walk.wad").string(), *wad.bytes(), /*durable=*/false));
  ASSERT_TRUE(write_file_atomically((folder / "scenario.toml").string(), "name = \"" + name + R"("
title = "Walk"
summary = "East is good."
difficulty = 1
default_agents = 2
supported_agents = [2]
decision_limit = 10
score = "POSITION_X"
ceiling = 2048
wad = "walk.wad"
[[heads]]
buttons = ["MOVE_FORWARD"]
[[rewards]]
name = "east"
variable = "POSITION_X"
kind = "delta"
weight = 0.5
[[rewards]]
name = "end"
variable = "ONE"
kind = "value"
weight = 100.0
when = "TRUNCATED"
)",
                                    /*durable=*/false));
  const auto layout = scenarios::generate_layout(folder.string(), {.num_agents = 2});
  ASSERT_TRUE(layout) << layout.error().message;
  write(layout->wad);
  const auto game = load({.scenario = folder.string()});
  ASSERT_TRUE(game) << game.error().message;
  DoomEnvironment env(*game);
  env.reset(1);
  float walker = 0, sleeper = 0;
  while (!env.last_step().episode_over()) {
    env.step(std::vector<int32_t>{1, 0});
    walker += env.last_step().reward[0], sleeper += env.last_step().reward[1];
  }
  EXPECT_TRUE(env.last_step().truncated);
  EXPECT_EQ(env.summary().length_steps, 10u);
  EXPECT_EQ(sleeper, 100.0f);
  EXPECT_NEAR(walker, 100.0 + 0.5 * (env.summary().agent_score[0] - 100.0), 0.01);
  EXPECT_GT(env.summary().agent_score[0], 250.0f);
  std::filesystem::remove_all(folder);
}

TEST_F(GameLoading, DeathmatchStartsDoForATeam) {
  const auto with_starts = [&](int own_starts, const std::string& others) {
    std::string bytes = wad_;
    for (int player = own_starts + 1; player <= 4; ++player) {
      const std::string from = "type = " + std::to_string(player) + ";";
      const std::size_t at = bytes.find(from);
      ASSERT_NE(at, std::string::npos);
      bytes.replace(at, from.size(), others);
    }
    write(bytes);
  };
  with_starts(1, "type =11;");
  const auto game = load({.num_agents = 4});
  ASSERT_TRUE(game) << game.error().message;
  DoomEnvironment env(*game);
  env.reset(3);
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < a; ++b)
      EXPECT_TRUE(env.world().body(a).x != env.world().body(b).x ||
                  env.world().body(a).y != env.world().body(b).y);
  with_starts(1, "type = 5;");
  EXPECT_THAT(message({.num_agents = 4}),
              HasSubstr("has starts for 1 players (0 of them for deathmatch), not for 4"));
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

}  // namespace game_loading_test
}  // namespace comrad::sim
