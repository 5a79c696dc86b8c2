// The commands that print one JSON object: eval and bench. stdout must hold that object and nothing else.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace measure_test {

using ::testing::HasSubstr;

/// Temporary run directories below `folder` that a command left.
size_t leftovers(const std::string& folder) { return files(folder, "comrad-").size(); }

/// Runs a command with --json in a scratch TMPDIR and gives its object.
nlohmann::json json_of(std::vector<std::string> arguments) {
  const ScratchFolder scratch;
  arguments.push_back("--json");
  const Ending ending = comrad(arguments, {{"TMPDIR", scratch.string()}});
  EXPECT_FALSE(ending.timed_out) << ending.err;
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_EQ(leftovers(scratch.string()), 0u);
  EXPECT_EQ(std::count(ending.out.begin(), ending.out.end(), '\n'), 1) << ending.out;
  return nlohmann::json::parse(ending.out, nullptr, false);
}

void expect_keys(const nlohmann::json& object, const std::vector<std::string>& keys) {
  ASSERT_TRUE(object.is_object());
  for (const std::string& key : keys) EXPECT_TRUE(object.contains(key)) << key;
}

const std::vector<std::string> kEvalKeys = {
    "scenario",    "policy",      "episodes",         "seed",    "num_agents", "layout", "J_mean", "J_ci95",
    "J_per_agent", "return_mean", "length_tics_mean", "ceiling", "J_share"};
constexpr const char* kStages[] = {"tic",     "render",  "hand_over", "gather",           "weights",
                                   "forward", "scatter", "collate",   "forward_backward", "optimizer",
                                   "publish"};
const std::vector<std::string> kBenchKeys = {
    "bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s", "env_frames_per_s"};

TEST(Eval, RandomPolicyPlaysTheRequestedEpisodes) {
  const auto summary = json_of({"eval", "--policy", "random", "--scenario", "coop_health_gathering",
                                "--episodes", "4", "--num_workers", "2", "--seed", "3"});
  expect_keys(summary, kEvalKeys);
  EXPECT_EQ(summary["policy"], "random");
  EXPECT_EQ(summary["episodes"], 4);
  EXPECT_EQ(summary["seed"], 3);
  EXPECT_EQ(summary["num_agents"], 2);
  EXPECT_EQ(summary["layout"], "seed 42");
  EXPECT_EQ(summary["J_per_agent"].size(), 2u);
  EXPECT_EQ(summary["ceiling"], 8400);
  EXPECT_GT(summary["J_mean"], 0);
  EXPECT_LE(summary["J_mean"], summary["ceiling"]);
  EXPECT_GE(summary["J_ci95"], 0);
}

TEST(Eval, AScriptedTeamsScoresAreSharesOfWhatEachLayoutAllows) {
  const auto summary = json_of({"eval", "--policy", "oracle", "--scenario", "coop_puzzle", "--layout_pool",
                                "eval:6", "--episodes", "6", "--each", "--num_workers", "1"});
  expect_keys(summary, kEvalKeys);
  ASSERT_EQ(summary["each"].size(), 6u);
  std::set<double> ceilings;
  double share = 0;
  for (const auto& one : summary["each"]) {
    const std::string layout = one["layout"];
    EXPECT_EQ(one["ceiling"], summary["ceiling_by_layout"][layout]) << layout;
    EXPECT_EQ(one["J"], summary["J_by_layout"][layout]) << layout;
    ceilings.insert(one["ceiling"].get<double>());
    share += one["J"].get<double>() / one["ceiling"].get<double>() / 6;
  }
  EXPECT_GT(ceilings.size(), 1u) << "six layouts with as many zones";
  EXPECT_NEAR(summary["J_share"].get<double>(), share, 1e-9);
  EXPECT_EQ(summary["J_share"], 1.0);
}

TEST(Bench, SimulatorReportsItsRate) {
  const auto summary = json_of({"bench", "sim", "--scenario", "coop_health_gathering", "--seconds", "0.5"});
  expect_keys(summary, kBenchKeys);
  EXPECT_EQ(summary["bench"], "sim");
  EXPECT_EQ(summary["cores"], 1);
  EXPECT_GE(summary["seconds"], 0.5);
  EXPECT_GT(summary["decisions_per_s"], 0);
  EXPECT_NEAR(summary["env_frames_per_s"].get<double>(), 4 * summary["decisions_per_s"].get<double>(), 1);
}

void expect_windows(const nlohmann::json& summary, size_t fewest) {
  ASSERT_TRUE(summary["windows"].is_array());
  EXPECT_GE(summary["windows"].size(), fewest);
  std::vector<double> rates = summary["windows"];
  std::ranges::sort(rates);
  EXPECT_GE(summary["decisions_per_s"], rates.front());
  EXPECT_LE(summary["decisions_per_s"], rates.back());
  EXPECT_GE(summary["spread"], 0);
}

std::map<std::string, nlohmann::json> parts_of_a_simulator(const std::string& seconds) {
  std::map<std::string, nlohmann::json> of;
  for (const char* bench : {"engine", "render", "sim"}) {
    of[bench] = json_of({"bench", bench, "--scenario", "coop_health_gathering", "--seconds", seconds});
    expect_keys(of[bench], kBenchKeys);
    expect_windows(of[bench], 1);
  }
  return of;
}

TEST(Bench, EngineAndRenderReportPartsOfASimulator) {
  std::map<std::string, nlohmann::json> of = parts_of_a_simulator("0.3");
  EXPECT_EQ(of["engine"]["player_tics_per_s"], of["engine"]["env_frames_per_s"]);
  EXPECT_EQ(of["render"]["views_per_s"], of["render"]["decisions_per_s"]);
}

TEST(BenchLong, APictureCostsMoreThanFourTics) {
  std::map<std::string, nlohmann::json> of = parts_of_a_simulator("1");
  EXPECT_GT(of["engine"]["decisions_per_s"], 2 * of["sim"]["decisions_per_s"].get<double>());
  EXPECT_GT(of["sim"]["cpu_seconds_per_1000_decisions"]["render"],
            of["sim"]["cpu_seconds_per_1000_decisions"]["tic"]);
}

TEST(Bench, InferenceReportsBatchSizesAndTheLearnerItsRate) {
  for (const char* bench : {"inference", "learner"}) {
    const auto summary =
        json_of({"bench", bench, "--rnn_size", "32", "--batch_size", "256", "--seconds", "0.5"});
    expect_keys(summary, kBenchKeys);
    EXPECT_EQ(summary["bench"], bench);
    EXPECT_GT(summary["decisions_per_s"], 0) << bench;
    expect_windows(summary, 1);
    if (bench != std::string("inference")) continue;
    std::vector<int> rows;
    for (const auto& batch : summary["batches"]) {
      rows.push_back(batch["batch_rows"]);
      EXPECT_GT(batch["rows_per_s"], 0);
      EXPECT_NEAR(batch["ms_per_batch"].get<double>() * batch["rows_per_s"].get<double>(),
                  1000. * rows.back(), 1e-3 * rows.back());
    }
    EXPECT_TRUE(std::ranges::is_sorted(rows));
    EXPECT_EQ(rows.front(), 2) << "one world of two agents";
    EXPECT_GE(rows.size(), 7u);
  }
}

TEST(BenchLong, TheLearnerRunsAllAlgorithms) {
  const auto summary = json_of({"bench", "learner", "--algo", "all", "--rnn_size", "16", "--rollout", "8",
                                "--batch_size", "64", "--seconds", "0.1"});
  expect_keys(summary, kBenchKeys);
  std::vector<std::string> names;
  for (const auto& row : summary["algorithms"]) {
    names.push_back(row["algo"]);
    EXPECT_GT(row["decisions_per_s"], 0) << row;
  }
  EXPECT_GE(names.size(), 8u);
  EXPECT_EQ(names.front(), summary["algo"].get<std::string>());
  EXPECT_EQ(summary["algorithms"][0]["of_the_first"], 1);
}

TEST(Bench, WhatCannotBeMeasuredIsRefusedAtOnceAndNamed) {
  const ScratchFolder scratch;
  std::ofstream(scratch / "no_marks.md") << "# Title\n";
  std::ofstream(scratch / "no_bench.json") << "{}";
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"bench", "simm"}, "did you mean 'sim'"},
      {{"bench", "sim", "--write", "x.md"}, "--write is for `comrad bench report`"},
      {{"bench", "train", "--agents", "2"}, "--agents is for `comrad bench scaling`"},
      {{"bench", "check", "--rounds", "0"}, "--rounds"},
      {{"bench", "scaling", "--parts", "replay"}, "'replay'"},
      {{"bench", "report", "--write", scratch / "no_marks.md"}, "comrad bench report: begin"},
      {{"bench", "report", "--write", scratch / "nowhere.md"}, "cannot be read"},
      {{"bench", "model"}, "--from"},
      {{"bench", "model", "--from", scratch / "no_bench.json"}, "cpu_seconds_per_1000_decisions"},
      {{"bench", "model", "--from", scratch / "no_bench.json", "--cores", "0"}, ""},
      {{"bench", "transport", "--seconds", "0"}, "--seconds"}};
  for (const auto& [words, named] : cases) {
    const Ending ending = comrad(words);
    EXPECT_EQ(ending.exit_code, 2) << words[1] << ": " << ending.err;
    EXPECT_THAT(ending.err, HasSubstr(named)) << words[1];
    EXPECT_EQ(ending.out, "") << words[1];
  }
  EXPECT_EQ(read_text(scratch / "no_marks.md"), "# Title\n");
}

TEST(Bench, AModelOfMoreCoresComesFromOneMeasurement) {
  const ScratchFolder scratch;
  std::ofstream(scratch / "train.json")
      << R"({"bench": "train", "cpu_seconds_per_1000_decisions": {"tic": 0.03, "render": 0.06, "hand_over": 0.01,
            "gather": 0.01, "weights": 0, "pack": 0, "forward": 0.08, "scatter": 0.01, "collate": 0.02, "forward_backward": 0.25,
            "optimizer": 0.02, "publish": 0.01, "other": 0}})";
  const auto model = json_of({"bench", "model", "--from", scratch / "train.json", "--cores", "1,16"});
  ASSERT_EQ(model["on"].size(), 2u);
  EXPECT_EQ(model["on"][0]["saturates"], "all cores");
  EXPECT_NEAR(model["on"][0]["decisions_per_s"].get<double>(), 2000, 1e-6);
  EXPECT_EQ(model["on"][1]["num_workers"], 16) << "as auto chooses on 16 cores";
  EXPECT_GT(model["on"][1]["decisions_per_s"], 2000);
}

TEST(Bench, ScalingMeasuresEveryPointOfItsGrid) {
  const auto summary = json_of({"bench", "scaling", "--parts", "engine", "--scenario", "armory_siege",
                                "--agents", "2,8", "--envs", "2", "--seconds", "0.3"});
  expect_keys(summary, kBenchKeys);
  ASSERT_EQ(summary["points"].size(), 2u);
  EXPECT_EQ(summary["points"][0]["num_agents"], 2);
  EXPECT_EQ(summary["points"][1]["num_agents"], 8);
  EXPECT_EQ(summary["points"][1]["num_envs_per_worker"], 2);
  EXPECT_EQ(summary["points"][0]["cost_of_an_agent"], 1);
  EXPECT_GT(summary["points"][1]["cost_of_an_agent"], 0);
}

TEST(TuneLong, MeasuresTheFirstSettingAndLeavesWhatTheUserFixed) {
  const ScratchFolder scratch;
  const std::string file = scratch / "tuned.toml";
  const auto found = json_of({"tune", "--scenario", "coop_health_gathering", "--algo", "ippo", "--precision",
                              "fp32", "--seconds", "1", "--rnn_size", "32", "--batch_size", "256",
                              "--num_envs_per_worker", "4", "--write", file});
  EXPECT_EQ(found["whole"], false) << "one second is enough for one setting";
  ASSERT_GE(found["tries"].size(), 2u);
  for (const auto& one : found["tries"]) {
    EXPECT_FALSE(one["settings"].contains("precision")) << "the user said it";
    EXPECT_GT(one["decisions_per_s"], 0) << one;
  }
  EXPECT_TRUE(found["tries"][1]["settings"].contains("num_workers"));
  EXPECT_GE(found["ratio"], 1.0);
  const Ending used = comrad({"config", "--scenario", "coop_health_gathering", "--config", file});
  EXPECT_EQ(used.exit_code, 0) << used.err;
}

nlohmann::json whole_pipeline(const std::string& seconds) {
  return json_of({"bench",
                  "train",
                  "--scenario",
                  "coop_health_gathering",
                  "--algo",
                  "ippo",
                  "--num_epochs",
                  "1",
                  "--rnn_type",
                  "gru",
                  "--rnn_size",
                  "32",
                  "--batch_size",
                  "256",
                  "--rollout",
                  "16",
                  "--num_envs_per_worker",
                  "4",
                  "--num_workers",
                  "2",
                  "--seconds",
                  seconds});
}

TEST(Bench, TheWholePipelineReportsItsRate) {
  const nlohmann::json summary = whole_pipeline("2");
  expect_keys(summary, kBenchKeys);
  EXPECT_EQ(summary["bench"], "train");
  EXPECT_GT(summary["env_frames_per_s"], 0);
  EXPECT_GT(summary["updates_per_s"], 0);
  EXPECT_EQ(summary["restarts"], 0);
  expect_windows(summary, 1);
  const nlohmann::json& cost = summary["cpu_seconds_per_1000_decisions"];
  const double all = cost["all"];
  for (const char* stage : kStages) EXPECT_GT(cost[stage], 0) << stage;
  EXPECT_NEAR(
      cost["simulators"].get<double>() + cost["policy_workers"].get<double>() + cost["learner"].get<double>(),
      all, 1e-6);
  const nlohmann::json& clocks = summary["policy_thread_us_per_decision"];
  double clocks_us = 0;
  for (const auto& [stage, us] : clocks.items()) clocks_us += us.get<double>();
  EXPECT_GT(clocks["forward"], 0);
  EXPECT_EQ(clocks["pack"], 0) << "a CPU reads frames where they are";
  const double window_us = 1e6 * summary["seconds"].get<double>() / summary["decisions"].get<double>();
  EXPECT_GT(clocks_us, 0.5 * window_us * summary["policy_workers"].get<double>())
      << "one thread a policy worker";
  EXPECT_LT(clocks_us, 1.5 * window_us * summary["policy_workers"].get<double>());
  // Every frame is copied into a batch once, the last row of a rollout into the next one, and small weights.
  EXPECT_GT(summary["bytes_copied_per_decision"], 27648);
  EXPECT_LT(summary["bytes_copied_per_decision"], 5 * 27648);
  EXPECT_GE(summary["cores_busy"].size(), 1u);
  EXPECT_THAT(summary["bottleneck"].get<std::string>(), ::testing::ContainsRegex("busy.*\\.$"));
}

TEST(BenchLong, TheStagesLeaveLittleOutAndCountNothingTwice) {
  const nlohmann::json cost = whole_pipeline("3")["cpu_seconds_per_1000_decisions"];
  double stages = 0;
  for (const char* stage : kStages) stages += cost[stage].get<double>();
  const double all = cost["all"];
  EXPECT_GT(stages, 0.8 * all) << cost;
  EXPECT_LT(stages, 1.1 * all) << cost;
}

TEST(Doctor, PrintsOneObjectAndFindsThisMachineFit) {
  const auto report = json_of({"doctor"});
  expect_keys(report, {"ok", "checks"});
  for (const nlohmann::json& check : report["checks"]) EXPECT_NE(check["level"], "FAIL") << check.dump();
}

TEST(Config, ShowsTheReplayThatIsChosenForThisMachine) {
  const auto config = json_of({"config", "--scenario", "lava_pit", "--algo", "vdn", "--replay_gb", "0.05",
                               "--replay_capacity_decisions", "1000000"});
  expect_keys(config, {"settings", "replay"});
  EXPECT_EQ(config["replay"]["capacity_bytes"], 50'000'000);
  EXPECT_EQ(config["replay"]["compress"], true) << "a million decisions take more";
  EXPECT_EQ(config["replay"]["file"], "");
  EXPECT_FALSE(json_of({"config", "--scenario", "lava_pit", "--algo", "ippo"}).contains("replay"));
  const Ending words = comrad({"config", "--scenario", "lava_pit", "--algo", "vdn"});
  EXPECT_THAT(words.out, HasSubstr("On this machine now: replay: room for "));
}

TEST(Scenarios, ListTheOnesThatTrainTakes) {
  const Ending ending = comrad({"scenarios"});
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.out, HasSubstr("coop_health_gathering"));
}

}  // namespace measure_test
}  // namespace comrad::test
