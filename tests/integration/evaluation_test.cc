// What is seen of a policy: films and episodes of `comrad eval`, and evaluations and milestones of a run that trains.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "tests/integration/running_program.h"

namespace comrad::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
namespace fs = std::filesystem;

constexpr double kTimeoutSeconds = 250;

std::vector<nlohmann::json> evaluations(const std::string& run) {
  std::vector<nlohmann::json> found;
  for (const nlohmann::json& report : read_json_lines(run + "/metrics.jsonl"))
    if (report.is_object() && report.contains("eval/J")) found.push_back(report);
  return found;
}

/// A small run that evaluates at every 4 096 env frames.
std::vector<std::string> evaluated_training(const ScratchFolder& scratch, double env_steps) {
  return small_training(scratch, "run", env_steps,
                        {"--eval_every_env_frames", "4096", "--eval_episodes", "2",
                         "--save_milestones_env_steps", "4096", "--keep_checkpoints", "1"});
}

TEST(Evaluation, FilmsWhatItPlaysAndTellsOfEveryEpisode) {
  const ScratchFolder scratch;
  const std::string video = scratch / "random.mp4", frames = scratch / "frames";
  const Ending ending =
      comrad({"eval", "--policy", "random", "--scenario", "coop_health_gathering", "--episodes", "1",
              "--save_video", video, "--frames", frames, "--size", "128x72", "--json"},
             kTimeoutSeconds);
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  const auto summary = nlohmann::json::parse(ending.out, nullptr, false);
  ASSERT_TRUE(summary.is_object()) << ending.out;
  ASSERT_THAT(summary["each"], SizeIs(1));
  EXPECT_EQ(summary["each"][0]["J"], summary["J_mean"]);
  EXPECT_THAT(summary["each"][0]["J_per_agent"], SizeIs(2));
  EXPECT_EQ(summary["video"], video);
  EXPECT_GT(fs::file_size(video), 1000u);
  // One at the beginning, then one a decision of four tics.
  EXPECT_EQ(files(frames, "episode_000_").size(),
            1 + (summary["each"][0]["length_tics"].get<size_t>() + 3) / 4);
}

TEST(Evaluation, FilmsThatCannotBeMadeAreRefusedBeforeAnythingStarts) {
  const ScratchFolder scratch;
  for (const auto& [words, message] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--save_video", scratch / "a.gif"}, "one of .mp4, .mkv"},
           {{"--save_video", scratch / "no/a.mp4"}, "is no folder"},
           {{"--frames", "/proc"}, "--frames="},
           {{"--save_video", scratch / "a.mp4", "--size", "9x9"}, "from 128x72"},
           {{"--size", "640x360"}, "add --save_video"},
           {{"--maps", "mine"}, "unknown maps 'mine'"},
           {{"--maps", "train", "--layout_seed", "3"}, "both name maps"},
           {{"--checkpoint", "x.pt"}, "--checkpoint is of a run"}}) {
    std::vector<std::string> command = {"eval", "--policy", "random"};
    command.insert(command.end(), words.begin(), words.end());
    const ScratchFolder temporary;
    const Ending ending = comrad(command, 30, {{"TMPDIR", temporary.string()}});
    EXPECT_EQ(ending.exit_code, 2) << message;
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_THAT(files(temporary.string(), ""), IsEmpty()) << message;
  }
}

TEST(EvaluationWhileTraining, EveryPointOnceAndTheLastOneToo) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  const Ending first = RunningProgram(evaluated_training(scratch, 4096)).wait(kTimeoutSeconds);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  std::vector<nlohmann::json> reports = evaluations(run);
  ASSERT_THAT(reports, SizeIs(1)) << first.err;
  EXPECT_GE(reports[0]["env_frames"], 4096);
  EXPECT_LT(reports[0]["env_frames"], 8192);
  EXPECT_EQ(reports[0]["eval/episodes"], 2);
  EXPECT_GT(reports[0]["eval/J"], 0);
  EXPECT_THAT(first.err, HasSubstr("evaluated at 4."));
  EXPECT_THAT(files(run + "/eval", "events.out.tfevents."), SizeIs(1));
  EXPECT_THAT(files(run, "events.out.tfevents."), SizeIs(1)) << "TensorBoard follows one file a folder";
  EXPECT_THAT(files(run + "/checkpoint", "evaluate_"), IsEmpty());
  EXPECT_THAT(files(run + "/checkpoint", "milestone_"), SizeIs(1));
  EXPECT_THAT(files(run + "/checkpoint", "checkpoint_"), SizeIs(1));
  EXPECT_FALSE(fs::exists(run + "/.evaluation"));

  // Resumed: the points behind it are not played again; a damaged checkpoint costs its evaluation alone.
  std::ofstream(run + "/checkpoint/evaluate_000000001_4100_1.pt") << "an old one";
  std::ofstream(run + "/checkpoint/evaluate_000000009_9000_1.pt") << "no checkpoint";
  const Ending second = RunningProgram(evaluated_training(scratch, 12288)).wait(kTimeoutSeconds);
  ASSERT_EQ(second.exit_code, 0) << second.err;
  EXPECT_THAT(second.err,
              AllOf(HasSubstr("the evaluation at 9k env frames failed"), Not(HasSubstr("at 4.1k"))));
  reports = evaluations(run);
  ASSERT_THAT(reports, SizeIs(2)) << second.err;  // 4 096 and 12 288; that of 8 192 was damaged
  EXPECT_GE(reports[1]["env_frames"], 12288);
  EXPECT_THAT(files(run + "/checkpoint", "milestone_"), SizeIs(3));
  EXPECT_TRUE(processes_of(run).empty());

  // A milestone can be played like any checkpoint.
  const Ending milestone = comrad({"eval", "--policy", run, "--checkpoint",
                                   files(run + "/checkpoint", "milestone_")[0], "--episodes", "1", "--json"},
                                  kTimeoutSeconds);
  EXPECT_EQ(milestone.exit_code, 0) << milestone.err;
}

TEST(EvaluationWhileTraining, NothingIsLeftWhenTheRunIsKilled) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  std::vector<std::string> command = evaluated_training(scratch, 1e8);
  command.insert(command.end(), {"--eval_episodes", "100000"});
  RunningProgram training(command);
  const auto evaluators = [&] { return processes_of(run + "/.evaluation", "comrad-sim-worker"); };
  ASSERT_TRUE(wait_until([&] { return !evaluators().empty(); }, kTimeoutSeconds));
  kill(training.pid(), SIGKILL);
  EXPECT_TRUE(wait_until([&] { return processes_of(run).empty(); }, 30));
  training.wait(5);

  // A resumed run clears what it left, plays the point that was given up, and ends with Ctrl-C as any other.
  RunningProgram again(command);
  ASSERT_TRUE(wait_until([&] { return !evaluators().empty(); }, kTimeoutSeconds));
  again.signal(SIGTERM);
  const Ending ending = again.wait(20 * patience());
  EXPECT_FALSE(ending.timed_out);
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_TRUE(wait_until([&] { return processes_of(run).empty(); }, 15));
  EXPECT_THAT(files(run + "/checkpoint", "evaluate_"), Not(IsEmpty())) << "the next start goes on with it";
}

}  // namespace
}  // namespace comrad::testing
