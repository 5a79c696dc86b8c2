#include "deploy/launch/evaluator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/metrics/learner_messages.h"
#include "tests/support/documented_metrics.h"
#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace evaluator_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
namespace fs = std::filesystem;

constexpr const char* kResult =
    R"({"J_mean": 12.5, "J_ci95": 1.5, "return_mean": 3, "length_tics_mean": 40, "J_share": null, "episodes": 2,
        "each": [{"J": 12}, {"J": 13}]})";

TEST(EvaluationMetrics, AreThoseOfTheObjectThatEvalPrints) {
  const Expected<MetricValues> values = evaluation_metrics(kResult);
  ASSERT_TRUE(values) << values.error().message;
  EXPECT_EQ(*values, (MetricValues{{"eval/J", 12.5},
                                   {"eval/J_ci95", 1.5},
                                   {"eval/return", 3},
                                   {"eval/length", 40},
                                   {"eval/episodes", 2},
                                   {"eval/J_min", 12},
                                   {"eval/J_max", 13}}));
  for (const char* broken :
       {"", "[]", "{", "{}", R"({"J_mean": "12"})",
        R"({"J_mean": null, "J_ci95": 1, "return_mean": 3, "length_tics_mean": 4, "J_share": 1,
                                 "episodes": 2})"})
    EXPECT_FALSE(evaluation_metrics(broken)) << broken;
}

/// A run directory, and a program `comrad` that follows a script.
class EvaluatorTest : public ::testing::Test {
 protected:
  void SetUp() override {
    plan_.run_dir = (folder_ / "run").string();
    plan_.bin_dir = (folder_ / "bin").string();
    plan_.config.run.eval_every_env_frames = 1000;
    plan_.config.run.eval_episodes = 2;
    plan_.config.environment.env_frameskip = 4;
    fs::create_directories(plan_.run_dir + "/checkpoint");
    fs::create_directories(plan_.bin_dir);
    comrad_says("echo \"$@\" >>'" + asked() + "'; echo $TMPDIR >'" + (folder_ / "tmpdir").string() +
                "'; cat <<X\n" + kResult + "\nX");
  }

  std::string asked() const { return (folder_ / "asked").string(); }
  void comrad_says(const std::string& script) {
    const std::string path = plan_.bin_dir + "/comrad";
    std::ofstream(path) << "#!/bin/sh\n" << script << "\n";
    fs::permissions(path, fs::perms::owner_all);
  }
  std::string save(uint64_t version, uint64_t env_frames) {
    const std::string folder = plan_.run_dir + "/checkpoint",
                      file = "evaluate_" + std::to_string(version) + "_" + std::to_string(env_frames) + ".pt";
    EXPECT_TRUE(request_evaluation(folder, {file, version, env_frames, /*train_seconds=*/7}));
    std::ofstream(folder + "/" + file) << "a checkpoint";
    return folder + "/" + file;
  }
  /// Checkpoints that were not evaluated yet.
  std::vector<std::string> waiting() const {
    std::vector<std::string> paths;
    for (const fs::directory_entry& entry : fs::directory_iterator(plan_.run_dir + "/checkpoint"))
      if (entry.path().extension() == ".pt") paths.push_back(entry.path().string());
    return paths;
  }
  /// Turns until nothing is left to do.
  std::vector<std::string> run_out(Evaluator& evaluator) {
    std::vector<std::string> words;
    evaluator.hurry();
    EXPECT_TRUE(test::wait_until([&] {
      for (std::string& text : evaluator.tick()) words.push_back(std::move(text));
      return !evaluator.is_busy();
    }));
    return words;
  }
  std::vector<nlohmann::json> metrics() const {
    std::vector<nlohmann::json> reports;
    std::ifstream lines(plan_.run_dir + "/metrics.jsonl");
    for (std::string line; std::getline(lines, line);) reports.push_back(nlohmann::json::parse(line));
    return reports;
  }

  const test::ScratchFolder folder_;
  LaunchPlan plan_;
  MachineProcessHost processes_;
  RunEvaluationFolder evaluations_{(folder_ / "run").string()};
};

TEST_F(EvaluatorTest, PlaysACheckpointWritesItsScoreAndDeletesIt) {
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  EXPECT_FALSE(evaluator.is_busy());
  const std::string path = save(3, 1024);
  EXPECT_THAT(
      run_out(evaluator),
      ElementsAre("evaluated at 1k env frames: J 12.5 +- 1.5 over 2 greedy episodes on the run's maps"));
  EXPECT_EQ(evaluator.last_text(), "eval J 12.5 at 1k");
  EXPECT_FALSE(fs::exists(path));
  const std::vector<nlohmann::json> reports = metrics();
  ASSERT_EQ(reports.size(), 1u);
  EXPECT_EQ(reports[0]["env_frames"], 1024);
  EXPECT_EQ(reports[0]["decisions"], 256);
  EXPECT_EQ(reports[0]["time_s"], 7);
  EXPECT_EQ(reports[0]["eval/J"], 12.5);
  EXPECT_EQ(reports[0]["eval/version"], 3);
  std::vector<std::string> names = {"eval/J_share"};  // null in this one
  for (const auto& [name, value] : reports[0].items())
    if (name.starts_with("eval/")) names.push_back(name);
  EXPECT_THAT(test::undocumented(test::documented_metrics({"eval/"}), names), IsEmpty());
  EXPECT_THAT(test::unwritten(test::documented_metrics({"eval/"}), names), IsEmpty());
  EXPECT_FALSE(fs::is_empty(plan_.run_dir + "/eval")) << "no separate event file";
  const std::string asked_for = read_file(asked()).value_or("");
  for (const std::string& words :
       {"eval --policy " + plan_.run_dir, "--checkpoint " + path, std::string("--episodes 2"),
        std::string("--maps train"), std::string("--background"), std::string("--json")})
    EXPECT_THAT(asked_for, HasSubstr(words));
  EXPECT_THAT(read_file((folder_ / "tmpdir").string()).value_or(""), HasSubstr(plan_.run_dir))
      << "what a killed evaluation leaves would not be found";
}

TEST_F(EvaluatorTest, NoPointIsPlayedTwiceWhateverIsKilled) {
  {
    Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
    save(3, 1024);
    run_out(evaluator);
    save(4, 1999);  // the learner went back and passed 1 000 again
    EXPECT_THAT(run_out(evaluator), IsEmpty());
  }
  save(5, 1500);  // and again, in a later life of the run
  save(9, 2004);
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  EXPECT_EQ(run_out(evaluator).size(), 1u);
  const std::vector<nlohmann::json> reports = metrics();
  ASSERT_EQ(reports.size(), 2u);
  EXPECT_EQ(reports[0]["env_frames"], 1024);
  EXPECT_EQ(reports[1]["env_frames"], 2004);
  EXPECT_THAT(waiting(), IsEmpty());
}

TEST_F(EvaluatorTest, ADueVideoIsRecordedBehindTheScoreAndKept) {
  plan_.config.run.video_every_env_frames = 2000;
  // `comrad eval` writes the file behind --save_video.
  comrad_says(
      "echo \"$@\" >>'" + asked() + "'; cat <<X\n" + kResult +
      "\nX\nwhile [ $# -gt 1 ]; do if [ $1 = --save_video ]; then printf 'GIF89a\\002\\000\\001\\000' "
      ">$2; fi; shift; done");
  {
    Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
    save(3, 1024);
    EXPECT_EQ(run_out(evaluator).size(), 1u) << "no video is due";
    save(4, 2048);
    const std::vector<std::string> words = run_out(evaluator);
    ASSERT_EQ(words.size(), 2u);
    EXPECT_THAT(words[0], HasSubstr("evaluated at 2k"));
    EXPECT_THAT(words[1],
                AllOf(HasSubstr("recorded a video at 2k"), HasSubstr("/videos/video_000000002048.gif")));
    EXPECT_THAT(waiting(), IsEmpty());
    EXPECT_THAT(read_file(asked()).value_or(""),
                AllOf(HasSubstr("--episodes 1 "), HasSubstr("--size 320x180 --seconds 20")));
  }
  // Another life of the run records no point twice; a video that fails costs itself alone.
  plan_.config.run.eval_every_env_frames = 0;
  comrad_says(std::string("cat <<X\n") + kResult + "\nX");
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  save(5, 3000);
  EXPECT_THAT(run_out(evaluator), IsEmpty());
  save(6, 4000);
  EXPECT_THAT(run_out(evaluator), ElementsAre(AllOf(HasSubstr("the video at 4k env frames failed"),
                                                    HasSubstr("is no GIF"), HasSubstr("run continues"))));
  EXPECT_THAT(waiting(), IsEmpty());
}

TEST_F(EvaluatorTest, ACheckpointThatCannotBePlayedIsReportedAndTheRunContinues) {
  comrad_says("echo 'comrad eval: error: learner cannot run: bad checkpoint' >&2; exit 2");
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  save(3, 1024);
  EXPECT_THAT(run_out(evaluator),
              ElementsAre(AllOf(HasSubstr("at 1k env frames failed (exit code 2"),
                                HasSubstr("bad checkpoint"), HasSubstr("the run continues"))));
  EXPECT_THAT(waiting(), IsEmpty()) << "it would fail again";
  comrad_says("echo '{}'");
  save(4, 2048);
  EXPECT_THAT(run_out(evaluator), ElementsAre(HasSubstr("gave no number J_mean")));
  comrad_says(std::string("cat <<X\n") + kResult + "\nX");
  save(5, 3072);
  EXPECT_THAT(run_out(evaluator), ElementsAre(HasSubstr("evaluated at 3.1k")));
}

TEST_F(EvaluatorTest, WithoutAProgramItReportsThatAndStops) {
  plan_.bin_dir += "/nowhere";
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  save(3, 1024);
  EXPECT_THAT(run_out(evaluator), ElementsAre(HasSubstr("continues without evaluations")));
}

TEST_F(EvaluatorTest, WhatIsGivenUpIsPlayedAtTheNextStart) {
  const std::string path = save(3, 1024);
  {
    comrad_says("exec sleep 100");
    Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
    evaluator.tick();
    ASSERT_TRUE(evaluator.is_busy());
    evaluator.stop(SIGTERM);
    EXPECT_THAT(run_out(evaluator), IsEmpty());
    EXPECT_TRUE(fs::exists(path));
  }
  EXPECT_FALSE(fs::exists(plan_.run_dir + "/.evaluation"));
  comrad_says(std::string("cat <<X\n") + kResult + "\nX");
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  EXPECT_EQ(run_out(evaluator).size(), 1u);
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(EvaluatorTest, ManyThatWaitLoseTheOldest) {
  comrad_says("exec sleep 100");
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  save(1, 1000);
  evaluator.tick();
  for (uint64_t point = 2; point <= Evaluator::kMostWaiting + 3; ++point) save(point, point * 1000);
  evaluator.hurry();
  const std::vector<std::string> words = evaluator.tick();
  ASSERT_EQ(words.size(), 2u);
  EXPECT_THAT(words[0],
              AllOf(HasSubstr("at 2k env frames is left out"), HasSubstr("--eval_every_env_frames")));
  EXPECT_THAT(words[1], HasSubstr("at 3k env frames"));
}

TEST_F(EvaluatorTest, WithoutTheSettingItTouchesNothing) {
  plan_.config.run.eval_every_env_frames = 0;
  const std::string path = save(3, 1024);
  Evaluator evaluator(plan_, kMachineClock, processes_, evaluations_);
  EXPECT_THAT(run_out(evaluator), IsEmpty());
  EXPECT_TRUE(fs::exists(path));
}

}  // namespace evaluator_test
}  // namespace comrad::deploy
