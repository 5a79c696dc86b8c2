// `comrad train` over real processes: what a run leaves behind, resuming, restarting, several runs at once.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace train_test {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;
namespace fs = std::filesystem;

/// Trains to `env_steps` and expects a clean end.
Ending train(const ScratchFolder& scratch, const std::string& experiment, double env_steps,
             const std::vector<std::string>& more = {}) {
  RunningProgram training(small_training(scratch, experiment, env_steps, more));
  Ending ending = training.wait();
  EXPECT_FALSE(ending.timed_out) << ending.err;
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_TRUE(processes_of(scratch / experiment).empty());
  return ending;
}

TEST(Train, LeavesACompleteRunDirectory) {
  const ScratchFolder scratch;
  train(scratch, "first", 4096, {"--worker_num_splits", "0"});  // auto, by this machine's cores
  const std::string run = scratch / "first";

  const nlohmann::json status = read_json(run + "/status.json");
  ASSERT_TRUE(status.is_object());
  EXPECT_EQ(status["state"], "finished");
  EXPECT_GE(status["env_frames"], 4096);
  EXPECT_EQ(status["env_frames"], 4 * status["decisions"].get<int64_t>());
  EXPECT_GE(status["learner_version"], 4096 / (256 * 4));

  const auto reports = read_json_lines(run + "/metrics.jsonl");
  ASSERT_FALSE(reports.empty());
  for (const nlohmann::json& report : reports) {
    ASSERT_TRUE(report.is_object());
    for (const char* key : {"time_s", "env_frames", "decisions"}) EXPECT_TRUE(report.contains(key)) << key;
  }
  EXPECT_GE(reports.back()["env_frames"], 4096);

  const std::string settings = read_text(run + "/config.toml");
  EXPECT_THAT(settings, HasSubstr("rnn_size = 32"));
  EXPECT_THAT(settings, AnyOf(HasSubstr("worker_num_splits = 1"), HasSubstr("worker_num_splits = 2")));
  EXPECT_THAT(files(run, "events.out.tfevents."), SizeIs(1));
  EXPECT_FALSE(files(run + "/checkpoint", "checkpoint_", ".pt").empty());
  EXPECT_THAT(files(run + "/layouts", "coop_health_gathering_42.wad"), SizeIs(1));
  for (const char* log : {"sim-0.log", "sim-1.log", "policy-0.log", "learner.log"})
    EXPECT_TRUE(fs::exists(run + "/logs/" + log) ||
                fs::exists(run + "/logs/" + std::string(log).insert(std::string(log).find('.'), "-0")))
        << log;
}

TEST(Train, ResumesWhereItStopped) {
  const ScratchFolder scratch;
  train(scratch, "run", 4096);
  const nlohmann::json before = read_json(scratch / "run/status.json");
  const Ending second = train(scratch, "run", 8192);
  const nlohmann::json after = read_json(scratch / "run/status.json");
  EXPECT_EQ(after["state"], "finished");
  EXPECT_GE(after["env_frames"], 8192);
  EXPECT_GE(before["env_frames"], 4096);
  EXPECT_GT(after["learner_version"], before["learner_version"]);
  EXPECT_EQ(after["message"], "finished (--train_for_env_frames 8192)");
  EXPECT_THAT(second.err,
              HasSubstr("comrad eval --policy " + (scratch / "run").string() + " --episodes 100\n"));
  double last = 0;  // had it started over, the count would fall back
  for (const nlohmann::json& report : read_json_lines(scratch / "run/metrics.jsonl")) {
    EXPECT_GE(report["env_frames"].get<double>(), last);
    last = report["env_frames"];
  }
  // Seconds count from the run's beginning: none are left, and the last line names the limit.
  const Ending over = train(scratch, "run", 1e6, {"--train_for_seconds", "0.001"});
  EXPECT_THAT(over.err,
              ::testing::ContainsRegex(
                  "finished \\(--train_for_seconds 0.001\\): [0-9.]+k env frames, 0 trained on in "));
  // A start prints what changed since the last one.
  const std::string changed = "note: changed since the last start: train_for_env_frames 4096.0 -> 8192.0\n";
  EXPECT_THAT(second.err, HasSubstr(changed));
  EXPECT_THAT(read_text(scratch / "run/logs/supervisor.log"), HasSubstr(changed));
  // Typed settings win over the run's own; what shapes the network is refused.
  const Ending refused = RunningProgram(small_training(scratch, "run", 8192, {"--rnn_size", "64"})).wait();
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("the run was made with 32"));
}

TEST(Train, ASecondRunOnTheSameDirectoryIsRefused) {
  const ScratchFolder scratch;
  RunningProgram first(small_training(scratch, "run", 1e8));
  ASSERT_TRUE(wait_until([&] { return env_frames(scratch / "run") > 0; }));
  for (const char* behaviour : {"resume", "restart", "overwrite"}) {
    const Ending second =
        RunningProgram(small_training(scratch, "run", 8192, {"--restart_behavior", behaviour})).wait();
    EXPECT_EQ(second.exit_code, 2) << behaviour;
    EXPECT_THAT(second.err, HasSubstr(std::to_string(first.pid()))) << behaviour;
  }
  EXPECT_TRUE(first.running());
  first.signal(SIGTERM);
  const Ending ending = first.wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
}

TEST(Train, NamesItselfAfterScenarioAlgorithmSeedAndTimeAndTwoStartsAtOnceDoNotMeet) {
  const ScratchFolder scratch;
  const std::vector<std::string> command = small_training(scratch, "", 1024);
  RunningProgram one(command), two(command);
  for (RunningProgram* run : {&one, &two}) {
    const Ending ending = run->wait();
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
  }
  const auto runs = files(scratch.string(), "coop_health_gathering_IPPO_s42_2");
  ASSERT_THAT(runs, SizeIs(2));
  for (const std::string& run : runs) {
    EXPECT_EQ(read_json(run + "/status.json")["state"], "finished");
    EXPECT_GE(env_frames(run), 1024);
    EXPECT_THAT(read_text(run + "/config.toml"),
                HasSubstr("experiment = \"" + fs::path(run).filename().string() + "\""));
  }
}

TEST(Train, ARunThatWouldEndBeforeItLearnsIsRefusedUnlessAsked) {
  const ScratchFolder scratch;
  const std::vector<std::string> too_short = {
      "--algo", "vdn", "--replay_gb", "0.2", "--learning_starts_decisions", "20000", "--per_omega", "0.9"};
  const Ending refused = RunningProgram(small_training(scratch, "run", 2000, too_short)).wait();
  EXPECT_EQ(refused.exit_code, 2);
  // A replay of 200 MB holds some 7000 decisions: half of them are there before all that was requested, and are more than the
  // trajectories that a learner which came late finds waiting when the run is over.
  EXPECT_THAT(refused.err,
              ::testing::ContainsRegex(
                  "learning begins at [0-9]+ env frames \\([0-9]+ agent decisions, half of what the "
                  "replay holds\\), the run ends at 2000"));
  EXPECT_FALSE(fs::exists(scratch / "run")) << "nothing is written before that";

  std::vector<std::string> asked = too_short;
  asked.emplace_back("--allow_no_update");
  const Ending ending = train(scratch, "run", 2000, asked);
  EXPECT_THAT(ending.err, HasSubstr("no update was made, so nothing was learned"));
  const std::string log = read_text(scratch / "run/logs/supervisor.log");
  for (const std::string& text : {ending.err, log}) {
    EXPECT_THAT(text, ::testing::ContainsRegex("note: replay: room for at least [0-9]+ agent decisions in"));
    EXPECT_THAT(text, HasSubstr("--per_omega 0.9 does nothing in this run (algo vdn)"));
  }
}

TEST(Train, TakesSettingsAndNoResultsFromTheConfigOfARun) {
  const ScratchFolder scratch;
  train(scratch, "old", 1024, {"--gamma", "0.9", "--layout_seed", "7"});
  EXPECT_TRUE(fs::exists(scratch / "old/layouts/coop_health_gathering_7.wad"));
  const Ending ending =
      comrad({"train", "--config", scratch / "old/config.toml", "--seed", "3", "--num_agents", "3"});
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.err, HasSubstr("note: " + (scratch / "old/config.toml").string() + " is a run's"));
  const auto runs = files(scratch.string(), "coop_health_gathering_IPPO_s3_");
  ASSERT_THAT(runs, SizeIs(1)) << "beside the old run, under its own name";
  const std::string config = read_text(runs[0] + "/config.toml");
  EXPECT_THAT(config, HasSubstr("gamma = 0.9\n"));
  EXPECT_THAT(config, HasSubstr("num_agents = 3\n"));
  EXPECT_THAT(config, HasSubstr("wad = \"" + runs[0] + "/layouts/coop_health_gathering_7.wad\""));
  EXPECT_THAT(config, HasSubstr("batch_size = 240\n")) << "256 again, for three agents";
}

}  // namespace train_test
}  // namespace comrad::test
