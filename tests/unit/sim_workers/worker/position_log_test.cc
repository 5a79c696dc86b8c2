#include "sim_workers/worker/position_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "scenarios/spec/registry.h"
#include "sim_workers/env/game_variables.h"
#include "tests/support/scratch_folder.h"

namespace comrad::sim {
namespace position_log_test {

/// Two environments on one generated map.
class PositionLogTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto layout = scenarios::generate_layout("coop_health_gathering", {});
    ASSERT_TRUE(layout) << layout.error().message;
    options_.scenario = "coop_health_gathering";
    options_.wad_path = folder_.write("map.wad", layout->wad);
    options_.count = 2;
    auto environments = make_doom_environment_set(options_);
    ASSERT_TRUE(environments) << environments.error().message;
    environments_ = std::move(*environments);
  }
  /// Steps to the end of an episode; gives each agent's place [2] at its start and after each decision.
  std::vector<std::vector<int>> play(DoomEnvironment& environment, uint64_t seed) const {
    const std::vector<int32_t> forward(
        static_cast<std::size_t>(environment.shape().num_agents * environment.shape().head_count), 1);
    std::vector<std::vector<int>> places(2);
    const auto look = [&] {
      for (int agent = 0; agent < 2; ++agent)
        for (const auto axis : {scenarios::VariableKind::kPositionX, scenarios::VariableKind::kPositionY})
          places[static_cast<std::size_t>(agent)].push_back(
              static_cast<int>(std::lround(read_variable(environment.world(), agent, {.kind = axis}))));
    };
    environment.reset(seed);
    for (look(); !environment.last_step().episode_over() || places[0].size() == 2; look())
      environment.step(forward);
    return places;
  }
  std::vector<nlohmann::json> lines() const {
    std::vector<nlohmann::json> found;
    std::ifstream file(folder_ / "positions.jsonl");
    for (std::string line; std::getline(file, line);) found.push_back(nlohmann::json::parse(line));
    return found;
  }

  const test::ScratchFolder folder_;
  EnvironmentOptions options_;
  std::unique_ptr<DoomEnvironmentSet> environments_;
};

TEST_F(PositionLogTest, HoldsTheMapOnceAndEveryEpisodeThatEnded) {
  auto log = PositionLog::create((folder_ / "positions.jsonl").string());
  ASSERT_TRUE(log) << log.error().message;
  (*log)->watch(*environments_);
  const std::vector<std::vector<int>> first = play(environments_->at(0), 1);
  const std::vector<std::vector<int>> second = play(environments_->at(1), 2);
  environments_->at(0).reset(3);  // begins an episode that does not end
  ASSERT_TRUE((*log)->finish());

  const std::vector<nlohmann::json> found = lines();
  ASSERT_EQ(found.size(), 3u);
  const doom::Level& level = *environments_->at(0).game().level;
  ASSERT_EQ(found[0]["lines"].size(), level.linedefs.size());
  EXPECT_EQ(found[0]["lines"][0].size(), 5u);
  std::size_t episode = 1;
  for (const auto& places : {first, second}) {
    EXPECT_EQ(found[episode]["layout"], found[0]["layout"]);
    EXPECT_EQ(found[episode]["positions"], nlohmann::json(places));
    EXPECT_EQ(found[episode]["decisions"], places[0].size() / 2 - 1);
    ++episode;
  }
  EXPECT_NE(first, second) << "seeds draw other starts";
}

TEST_F(PositionLogTest, AFileThatCannotBeWrittenIsAnError) {
  EXPECT_FALSE(PositionLog::create((folder_ / "gone/positions.jsonl").string()));
  auto log = PositionLog::create("/dev/full");
  if (!log) GTEST_SKIP() << "there is no /dev/full";
  (*log)->watch(*environments_);
  play(environments_->at(0), 1);
  const Status done = (*log)->finish();
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kNoSpace);
}

}  // namespace position_log_test
}  // namespace comrad::sim
