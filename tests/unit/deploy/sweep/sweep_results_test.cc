// What is kept of a run, and when it is stale.
#include "deploy/sweep/sweep_results.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/layers.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace sweep_results_test {

using ::testing::HasSubstr;

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream source(text);
  for (std::string line; std::getline(source, line);) lines.push_back(line);
  return lines;
}

TEST(CurveOf, KeepsTheFirstAndTheLastPointAndEvenlySpreadOnesBetween) {
  std::string text = "{\"torn\n{\"env_frames\": 5, \"policy_stats/avg_true_objective\": null}\n";
  for (int row = 0; row < 101; ++row)
    text += "{\"env_frames\": " + std::to_string(row + 1) +
            "123456, \"policy_stats/avg_true_objective\": 0.98765432, \"train/loss\": 1}\n";
  const std::vector<std::string> lines = lines_of(curve_of(text, 11));
  ASSERT_EQ(lines.size(), 12u);
  EXPECT_EQ(lines[0], "env_frames,J");
  for (std::size_t i = 1; i < lines.size(); ++i)
    EXPECT_EQ(lines[i], std::to_string(10 * (i - 1) + 1) + "123456,0.98765");
  EXPECT_EQ(lines_of(curve_of(text, 1000)).size(), 102u);
  EXPECT_EQ(lines_of(curve_of(text, 1)), (std::vector{lines.front(), lines.back()}));
  EXPECT_EQ(curve_of("", 10), "env_frames,J\n");
}

TEST(CurveOf, LeavesOutWhatAResumedRunForgot) {
  std::string text;
  for (const int frames : {100, 200, 300, 200, 250})
    text += "{\"env_frames\": " + std::to_string(frames) +
            ", \"policy_stats/avg_true_objective\": " + std::to_string(text.size()) + "}\n";
  const std::vector<std::string> lines = lines_of(curve_of(text, 60));
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(lines[1], "100,0");
  EXPECT_TRUE(lines[2].starts_with("200,")) << lines[2];
  EXPECT_TRUE(lines[3].starts_with("250,")) << lines[3];
}

TEST(SweepResults, ATimeCountsAllStartsOfARun) {
  EXPECT_EQ(trained_s(R"({"time_s":580.5,"env_frames":74}
{"time_s":787.25,"env_frames":100}
half a li)"),
            787.25);
  EXPECT_EQ(trained_s(""), 0);
  EXPECT_EQ(trained_s("{\"env_frames\":1}\n[3]\n"), 0);
}

TEST(RecipeChanges, AreWhatChangesLearning) {
  RunConfig then;
  then.run.algo = "ippo";
  RunConfig now = then;
  now.run.seed = 7;
  now.run.train_dir = "/elsewhere";
  now.collection.num_workers = 5;
  now.optimisation.micro_batch_size = 128;
  EXPECT_EQ(recipe_changes(then, now), "");
  now.optimisation.learning_rate = 2e-4;
  now.q_learning.td_lambda = 0.1;  // IPPO has none
  EXPECT_EQ(recipe_changes(then, now), "learning_rate 1e-04 -> 2e-04");
}

Expected<ScenarioDescription> describe(const RunConfig& config) {
  ScenarioDescription scenario;
  scenario.name = config.run.scenario;
  scenario.supported_agents = {2};
  scenario.env.num_agents = 2;
  scenario.env.head_count = 1;
  scenario.env.head_sizes[0] = 3;
  return scenario;
}

TEST(StaleResults, SayWhichSettingOrMapIsAnotherNow) {
  const test::ScratchFolder scratch;
  SweepPlan plan;
  plan.cores = 2;
  plan.file.results.folder = scratch.string();
  SweepRun run;
  run.name = "field_ippo";
  run.settings = {"", {{"scenario", "field"}, {"algo", "ippo"}}};
  plan.runs.push_back(run);
  std::string hash = "xxh3:1";
  const auto map_hash = [&](const RunConfig&) -> Expected<std::string> { return hash; };
  const auto stale = [&] {
    const Expected<int> count = note_stale_results(plan, describe, map_hash);
    EXPECT_TRUE(count) << count.error().message;
    const auto kept = read_result(plan.file.results, "field_ippo");
    EXPECT_EQ(*count, kept && !kept->stale.empty() ? 1 : 0);
    return kept ? kept->stale : "none";
  };
  EXPECT_EQ(stale(), "none");

  RunConfig config = merge_new({"", run.settings}, describe, 2)->config;
  scratch.write("field_ippo/config.toml", settings_to_toml(config));
  scratch.write(
      "field_ippo/result.json",
      R"({"train_for_env_frames": 1000, "J_mean": 2.5, "map_hashes": {"seed 42": "xxh3:1"}, "kept": [1]})");
  EXPECT_EQ(stale(), "");
  EXPECT_EQ(read_result(plan.file.results, "field_ippo")->score, 2.5);
  hash = "xxh3:2";
  EXPECT_EQ(stale(), "the map");
  plan.runs[0].settings.values.emplace_back("gamma", "0.5");
  EXPECT_THAT(stale(), HasSubstr("gamma 0.99 -> 0.5, the map"));
  EXPECT_THAT(*read_file(scratch.string() + "/field_ippo/result.json"),
              HasSubstr("\"kept\""));  // the rest stays
  plan.runs[0].settings.values.pop_back();
  hash = "xxh3:1";
  EXPECT_EQ(stale(), "");
  scratch.write("field_ippo/config.toml", "no_such_setting = 1\n");
  EXPECT_THAT(stale(), HasSubstr("cannot be read any more"));
  scratch.write("field_ippo/result.json", "{");
  EXPECT_EQ(stale(), "none");
}

}  // namespace sweep_results_test
}  // namespace comrad::deploy
