// The commands that print one JSON object: eval and bench. stdout must hold that object and nothing else.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/integration/running_program.h"

namespace comrad::testing {
namespace {

using ::testing::HasSubstr;

/// Temporary run directories below `folder` that a command left.
size_t leftovers(const std::string& folder) { return files(folder, "comrad-").size(); }

/// Runs a command with --json in a scratch TMPDIR and gives its object.
nlohmann::json json_of(std::vector<std::string> arguments, double timeout_s) {
  const ScratchFolder scratch;
  arguments.push_back("--json");
  const Ending ending = comrad(arguments, timeout_s, {{"TMPDIR", scratch.string()}});
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
const std::vector<std::string> kBenchKeys = {
    "bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s", "env_frames_per_s"};

TEST(Eval, RandomPolicyPlaysTheEpisodesItIsAskedFor) {
  const auto summary = json_of({"eval", "--policy", "random", "--scenario", "coop_health_gathering",
                                "--episodes", "4", "--num_workers", "2", "--seed", "3"},
                               90);
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
                                "eval:6", "--episodes", "6", "--each", "--num_workers", "1"},
                               90);
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

TEST(Eval, TheSameSeedPlaysTheSameEpisodes) {
  const std::vector<std::string> command = {
      "eval",       "--policy", "random",        "--scenario", "coop_health_gathering",
      "--episodes", "3",        "--num_workers", "1"};
  const auto first = json_of(command, 90), second = json_of(command, 90);
  EXPECT_EQ(first["J_mean"], second["J_mean"]);
  EXPECT_EQ(first["return_mean"], second["return_mean"]);
}

TEST(Eval, PlaysATrainedRunGreedilyAndLeavesItAlone) {
  const ScratchFolder scratch;
  ASSERT_EQ(RunningProgram(small_training(scratch, "run", 4096)).wait(90).exit_code, 0);
  const std::string config = read_text(scratch / "run/config.toml");
  const auto entries = files(scratch / "run", "");
  const auto summary =
      json_of({"eval", "--policy", "run", "--train_dir", scratch.string(), "--episodes", "2"}, 120);
  expect_keys(summary, kEvalKeys);
  EXPECT_EQ(summary["policy"], "run");
  EXPECT_EQ(summary["episodes"], 2);
  EXPECT_EQ(summary["greedy"], true);
  EXPECT_EQ(read_text(scratch / "run/config.toml"), config);
  EXPECT_EQ(files(scratch / "run", ""), entries);
}

TEST(Bench, SimulatorReportsItsRate) {
  const auto summary = json_of({"bench", "sim", "--scenario", "coop_health_gathering", "--seconds", "2"}, 60);
  expect_keys(summary, kBenchKeys);
  EXPECT_EQ(summary["bench"], "sim");
  EXPECT_EQ(summary["cores"], 1);
  EXPECT_NEAR(summary["seconds"].get<double>(), 2, 1);
  EXPECT_GT(summary["decisions_per_s"], 100);
  EXPECT_NEAR(summary["env_frames_per_s"].get<double>(), 4 * summary["decisions_per_s"].get<double>(), 1);
}

TEST(Bench, InferenceAndLearnerReportTheirRates) {
  for (const char* bench : {"inference", "learner"}) {
    const auto summary =
        json_of({"bench", bench, "--rnn_size", "32", "--batch_size", "256", "--seconds", "2"}, 90);
    expect_keys(summary, kBenchKeys);
    EXPECT_EQ(summary["bench"], bench);
    EXPECT_GT(summary["decisions_per_s"], 10) << bench;
  }
}

TEST(Tune, MeasuresTheFirstSettingAndLeavesWhatTheUserFixed) {
  const ScratchFolder scratch;
  const std::string file = scratch / "tuned.toml";
  const auto found = json_of(
      {"tune", "--scenario", "coop_health_gathering", "--algo", "ippo", "--precision", "fp32", "--seconds",
       "1", "--rnn_size", "32", "--batch_size", "256", "--num_envs_per_worker", "4", "--write", file},
      200);
  EXPECT_EQ(found["whole"], false) << "one second is enough for one setting";
  ASSERT_GE(found["tries"].size(), 2u);
  for (const auto& one : found["tries"]) {
    EXPECT_FALSE(one["settings"].contains("precision")) << "the user said it";
    EXPECT_GT(one["decisions_per_s"], 10) << one;
  }
  EXPECT_TRUE(found["tries"][1]["settings"].contains("num_workers"));
  EXPECT_GE(found["ratio"], 1.0);
  const Ending used = comrad({"config", "--scenario", "coop_health_gathering", "--config", file}, 30);
  EXPECT_EQ(used.exit_code, 0) << used.err;
}

TEST(Bench, TheWholePipelineReportsItsRate) {
  const auto summary = json_of({"bench",
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
                                "3"},
                               90);
  expect_keys(summary, kBenchKeys);
  EXPECT_EQ(summary["bench"], "train");
  EXPECT_GT(summary["env_frames_per_s"], 100);
  EXPECT_GT(summary["updates_per_s"], 0);
  EXPECT_EQ(summary["restarts"], 0);
}

TEST(Doctor, PrintsOneObjectAndFindsThisMachineFit) {
  const auto report = json_of({"doctor"}, 120);
  expect_keys(report, {"ok", "checks"});
  for (const nlohmann::json& check : report["checks"]) EXPECT_NE(check["level"], "FAIL") << check.dump();
}

TEST(Config, ShowsTheReplayThatIsChosenForThisMachine) {
  const auto config = json_of({"config", "--scenario", "lava_pit", "--algo", "vdn", "--replay_gb", "0.05",
                               "--replay_capacity_decisions", "1000000"},
                              60);
  expect_keys(config, {"settings", "replay"});
  EXPECT_EQ(config["replay"]["capacity_bytes"], 50'000'000);
  EXPECT_EQ(config["replay"]["compress"], true) << "a million decisions take more";
  EXPECT_EQ(config["replay"]["file"], "");
  EXPECT_FALSE(json_of({"config", "--scenario", "lava_pit", "--algo", "ippo"}, 60).contains("replay"));
  const Ending words = comrad({"config", "--scenario", "lava_pit", "--algo", "vdn"});
  EXPECT_THAT(words.out, HasSubstr("On this machine now: replay: room for "));
}

TEST(Scenarios, ListTheOnesThatTrainTakes) {
  const Ending ending = comrad({"scenarios"});
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.out, HasSubstr("coop_health_gathering"));
}

}  // namespace
}  // namespace comrad::testing
