// What is seen of a policy: videos and episodes of `comrad eval`, and evaluations and milestones of a run that trains.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>

#include "tests/integration/running_program.h"
#include "tests/support/gif_seconds.h"

namespace comrad::test {
namespace evaluation_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
namespace fs = std::filesystem;

constexpr double kBackgroundSeconds = 2 * kPatienceSeconds;  // of evaluations that take what others leave

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

TEST(Evaluation, RecordsWhatItPlaysAndReportsEveryEpisode) {
  const ScratchFolder scratch;
  const std::string video = scratch / "random.mp4", frames = scratch / "frames";
  const Ending ending =
      comrad({"eval", "--policy", "random", "--scenario", "coop_health_gathering", "--episodes", "1",
              "--save_video", video, "--frames", frames, "--size", "128x72", "--json"});
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

TEST(Evaluation, AVideoMayEndBeforeItsEpisodeAndCountsItsFrames) {
  const ScratchFolder scratch;
  const std::string video = scratch / "noop.gif";
  const Ending ending = comrad({"eval", "--policy", "random", "--scenario", "coop_health_gathering",
                                "--save_video", video, "--size", "128x72", "--seconds", "1"});
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.err, HasSubstr("/35 tics | "));
  EXPECT_GT(fs::file_size(video), 1000u);
  EXPECT_LT(fs::file_size(video), 300'000u);
}

TEST(Evaluation, VideosThatCannotBeMadeAreRefusedBeforeAnythingStarts) {
  const ScratchFolder scratch;
  for (const auto& [words, message] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--save_video", scratch / "a.avi"}, "one of .mp4, .mkv, .gif"},
           {{"--save_video", scratch / "a.gif", "--seconds", "0"}, "--seconds=0: write how long"},
           {{"--seconds", "20"}, "add --save_video"},
           {{"--save_video", scratch / "no/a.mp4"}, "is no folder"},
           {{"--frames", "/proc"}, "--frames="},
           {{"--save_video", scratch / "a.mp4", "--size", "9x9"}, "from 128x72"},
           {{"--size", "640x360"}, "add --save_video"},
           {{"--maps", "mine"}, "unknown maps 'mine'"},
           {{"--maps", "train", "--layout_seed", "3"}, "both name maps"},
           {{"--checkpoint", "x.pt"}, "--checkpoint is of a run"},
           {{"--json", "--csv"}, "both go to standard output"},
           {{"--episodes_file", scratch / "a.txt"}, "one of .csv, .jsonl"},
           {{"--episodes_file", scratch / "no/a.csv"}, "is no folder"},
           {{"--policy", "oracle", "--save_video", scratch / "a.mp4"}, "are of one team"},
           {{"--policy", "oracle", "--positions_file", scratch / "a.jsonl"}, "are of one team"},
           {{"--policy", "oracle", "--episodes_dir", scratch / "e"}, "are of one team"},
           {{"--episodes_dir", scratch / "no/e"}, "is no folder"},
           {{"--episodes_dir", "/proc"}, "--episodes_dir="},
           {{"--episodes_dir", scratch / "e", "--frames", scratch / "f"}, "start comrad eval twice"},
           {{"--policy", ""}, "the value is empty"},
           {{"--policy", "no_such_run"}, "no run 'no_such_run'"},
           {{"--cross_play", "random,oracle"}, "leave --policy and --seat out"},
           {{"--seat", "7=oracle"}, "--seat=7=oracle: the team has 2 agents"},
           {{"--seat", "0=oracle,1=noop"}, "--policy has none to play"}}) {
    std::vector<std::string> command = {"eval", "--policy", "random"};
    command.insert(command.end(), words.begin(), words.end());
    const ScratchFolder temporary;
    const Ending ending = comrad(command, {{"TMPDIR", temporary.string()}});
    EXPECT_EQ(ending.exit_code, 2) << message;
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_THAT(files(temporary.string(), ""), IsEmpty()) << message;
  }
}

/// The answer of `comrad eval <words> --json`.
nlohmann::json answer_of(std::vector<std::string> words) {
  words.insert(words.begin(), "eval");
  words.push_back("--json");
  const Ending ending = comrad(words);
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  nlohmann::json answer = nlohmann::json::parse(ending.out, nullptr, false);
  EXPECT_TRUE(answer.is_object()) << ending.out;
  return answer;
}

TEST(Evaluation, SeveralPoliciesMeetTheSameEpisodes) {
  const ScratchFolder scratch;
  const std::string table = scratch / "episodes.csv", lines = scratch / "episodes.jsonl";
  const auto all = answer_of({"--policy", "random,noop", "--policy", "oracle", "--episodes", "3",
                              "--num_workers", "2", "--layout_seed", "7", "--episodes_file", table});
  ASSERT_THAT(all["policies"], SizeIs(3));
  EXPECT_EQ(all["policies"][1]["policy"], "noop");
  EXPECT_EQ(all["policies"][0]["J_normalised"], 0.0);
  EXPECT_EQ(all["policies"][2]["J_normalised"], 1.0);
  EXPECT_LT(all["policies"][1]["J_normalised"], 0.5);
  EXPECT_EQ(all["layout"], "seed 7");
  const std::string hash = all["policies"][0]["map_hashes"]["seed 7"];
  EXPECT_THAT(hash, ::testing::MatchesRegex("xxh3:[0-9a-f]{16}"));
  const std::string rows = read_text(table);
  EXPECT_THAT(rows, ::testing::StartsWith(
                        "policy,scenario,episode,seed,layout,map_hash,J,J_per_agent_0,J_per_agent_1,"));
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 1 + 3 * 3);
  EXPECT_THAT(rows, HasSubstr("\nnoop,coop_health_gathering,2,"));
  EXPECT_THAT(rows, HasSubstr(",scenario_version\n"));
  EXPECT_EQ(all["policies"][0]["scenario_version"], 1);

  // How many workers and environments share the episodes decides nothing, and neither do the other players.
  const auto alone = answer_of({"--policy", "random", "--episodes", "3", "--num_workers", "1",
                                "--layout_seed", "7", "--episodes_file", lines});
  EXPECT_EQ(alone["each"], all["policies"][0]["each"]);
  EXPECT_TRUE(alone["J_normalised"].is_null()) << "this map was not measured";
  const auto episodes = read_json_lines(lines);
  ASSERT_THAT(episodes, SizeIs(3));
  EXPECT_EQ(episodes[1]["J"], alone["each"][1]["J"]);
  EXPECT_EQ(episodes[1]["map_hash"], hash);
}

TEST(Evaluation, ScoresOfTheDefaultMapAreNormalisedAndFitATable) {
  const Ending ending = comrad({"eval", "--policy", "random,noop", "--episodes", "2", "--csv"});
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.out,
              ::testing::StartsWith("policy,scenario,num_agents,layout,episodes,seed,greedy,J_mean,"));
  EXPECT_EQ(std::count(ending.out.begin(), ending.out.end(), '\n'), 3);
  const auto summary = answer_of({"--policy", "random", "--episodes", "2"});
  EXPECT_NEAR(summary["J_normalised"].get<double>(), 0, 0.02);
  EXPECT_EQ(summary["references"]["from"], "scenarios/reference_scores.toml");
}

/// Two runs of other algorithms, cores and inputs, made once for the tests below; and copies that claim to be of another
/// game.
class EvaluationOfRuns : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    scratch_ = std::make_unique<ScratchFolder>();
    for (const std::vector<std::string>& command :
         {small_training(*scratch_, "a", 2048, {"--seed", "1"}),
          small_training(*scratch_, "b", 2048, {"--seed", "2", "--algo", "mappo", "--rnn_type", "lstm"})}) {
      const Ending ending = RunningProgram(command).wait();
      ASSERT_EQ(ending.exit_code, 0) << ending.err;
    }
  }
  static void TearDownTestSuite() { scratch_.reset(); }

  static std::string run(const std::string& name) { return *scratch_ / name; }
  static std::string checkpoint(const std::string& name) {
    return files(run(name) + "/checkpoint", "checkpoint_").back();
  }
  /// A copy of run a whose config.toml has another value of `setting`.
  static std::string copy_with(const std::string& name, const std::string& setting,
                               const std::string& value) {
    fs::copy(run("a"), run(name), fs::copy_options::recursive);
    std::string text = read_text(run(name) + "/config.toml");
    const std::size_t at = text.find("\n" + setting + " = ") + 1;
    text.replace(at, text.find('\n', at) - at, setting + " = " + value);
    std::ofstream(run(name) + "/config.toml") << text;
    return run(name);
  }
  /// Plays two episodes.
  static nlohmann::json play(std::vector<std::string> words) {
    words.insert(words.end(), {"--episodes", "2"});
    return answer_of(std::move(words));
  }
  static void expect_refused(std::vector<std::string> words, const std::vector<std::string>& messages) {
    words.insert(words.begin(), "eval");
    const Ending ending = comrad(words);
    EXPECT_EQ(ending.exit_code, 2) << ending.out;
    for (const std::string& message : messages) EXPECT_THAT(ending.err, HasSubstr(message));
  }
  static inline std::unique_ptr<ScratchFolder> scratch_;
};

TEST_F(EvaluationOfRuns, TheSameCommandPlaysTheSameEpisodesAndLeavesTheRunAlone) {
  const std::string config = read_text(run("a") + "/config.toml");
  const std::vector<std::string> entries = files(run("a"), "");
  for (const char* way : {"--greedy", "--stochastic"}) {
    const auto first = play({"--policy", run("a"), way, "--num_workers", "2"});
    EXPECT_EQ(play({"--policy", run("a"), way, "--num_workers", "2"})["each"], first["each"]) << way;
    EXPECT_THAT(first["config_hash"].get<std::string>(), ::testing::StartsWith("xxh3:"));
    EXPECT_THAT(first["checkpoint_hash"].get<std::string>(), ::testing::StartsWith("xxh3:"));
    EXPECT_NE(first["config_hash"], first["checkpoint_hash"]);
    EXPECT_EQ(first["greedy"], way == std::string("--greedy"));
  }
  EXPECT_EQ(read_text(run("a") + "/config.toml"), config);
  EXPECT_EQ(files(run("a"), ""), entries);
}

TEST_F(EvaluationOfRuns, EverySeatHasItsOwnPlayer) {
  const std::vector<std::string> command = {"--seat", "0=" + run("a"), "--seat", "1=" + run("b"),
                                            "--stochastic"};
  const auto together = play(command);
  EXPECT_EQ(together["policy"], "0=" + run("a") + ",1=" + run("b"));
  EXPECT_THAT(together["each"], SizeIs(2));
  const auto alone = play({"--policy", run("a"), "--stochastic"});
  EXPECT_NE(alone["each"], together["each"]);
  EXPECT_EQ(together["config_hash"].get<std::string>().substr(0, 21),
            alone["config_hash"].get<std::string>());

  const auto scripted = play({"--policy", "noop", "--seat", "1=oracle"}), idle = play({"--policy", "noop"});
  EXPECT_EQ(scripted["policy"], "0=noop,1=oracle");
  EXPECT_EQ(scripted["greedy"], false);
  EXPECT_GT(scripted["return_mean"], idle["return_mean"]) << "one of the two collects";
  const auto whole = play({"--policy", run("a"), "--seat", "0=oracle"});
  EXPECT_EQ(whole["seats"][0], "oracle");
  EXPECT_EQ(whole["greedy"], true);
}

TEST_F(EvaluationOfRuns, EachPlayerMeetsEachOther) {
  const auto result = play({"--cross_play", run("a") + "," + run("b"), "--num_workers", "2"});
  EXPECT_EQ(result["players"], (nlohmann::json{run("a"), run("b")}));
  ASSERT_THAT(result["cells"], SizeIs(4));
  double self = 0, cross = 0;
  for (std::size_t row = 0; row < 2; ++row)
    for (std::size_t column = 0; column < 2; ++column) {
      EXPECT_EQ(result["J"][row][column], result["cells"][2 * row + column]["J_mean"]);
      (row == column ? self : cross) += result["J"][row][column].get<double>();
    }
  EXPECT_NEAR(result["self_play"]["J_mean"].get<double>(), self / 2, 1e-6);
  EXPECT_NEAR(result["gap"]["J_mean"].get<double>(), (self - cross) / 2, 1e-6);
  EXPECT_EQ(result["cells"][2]["row"], run("b"));
  EXPECT_EQ(result["cells"][2]["column"], run("a"));
  EXPECT_EQ(result["cells"][2]["seats"], (nlohmann::json{run("b"), run("a")}));
  EXPECT_EQ(result["cells"][3]["each"], play({"--policy", run("b"), "--num_workers", "2"})["each"])
      << "with itself a run plays as alone";

  const Ending table = comrad({"eval", "--cross_play", "random,noop", "--episodes", "2"});
  EXPECT_THAT(table.out, AllOf(HasSubstr("seat 0 \\ others"), HasSubstr("self-play "), HasSubstr("gap ")));
}

TEST_F(EvaluationOfRuns, AnotherVariantOrVersionIsPlayedAndReported) {
  const std::string older = copy_with("older", "scenario_version", "7");
  const Ending ending = comrad({"eval", "--policy", older, "--variant", "reference", "--env_frameskip", "1",
                                "--decision_limit", "40", "--episodes", "1", "--json"});
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(
      ending.err,
      HasSubstr(
          "was trained with scenario coop_health_gathering and plays with coop_health_gathering@reference"));
  EXPECT_THAT(ending.err, HasSubstr("was trained with scenario_version 7 and plays with 1"));
  const auto answer = nlohmann::json::parse(ending.out);
  EXPECT_EQ(answer["scenario"], "coop_health_gathering@reference");
  EXPECT_EQ(answer["each"][0]["length_tics"], 40);
  EXPECT_NEAR(answer["return_mean"].get<double>(), 10, 2)
      << "the first decision's 10; a hit of the floor, perhaps a kit";
  expect_refused({"--policy", older, "--variant", "refrence"},
                 {"has no variant 'refrence'", "known: default, reference"});
}

TEST_F(EvaluationOfRuns, RewardsInStagesAreNotWhatIsScored) {
  const std::vector<std::string> words = {"--decision_limit", "30", "--policy"};
  const auto played = [&](const std::string& player) {
    std::vector<std::string> all = words;
    all.push_back(player);
    return play(all)["each"];
  };
  const auto own = played(run("a"));
  EXPECT_EQ(played(copy_with("staged", "reward", "\"health_lost=-100@0,-200@1e6\"")), own);
  EXPECT_NE(played(copy_with("changed", "reward", "\"health_lost=-100\"")), own);
  expect_refused({"--policy", run("a"), "--reward", "health_lost=-1@0,-2@1e6"},
                 {"--reward=health_lost=-1@0,-2@1e6", "give each term one number"});
}

// A sweep's folder with the runs of this suite and what their evaluations kept.
TEST_F(EvaluationOfRuns, PoliciesBesideTheScenariosPlay) {
  const std::string fetched = *scratch_ / "beside";
  const Ending done = comrad({"fetch-policies", "--train_dir", fetched}, {{"COMRAD_POLICIES", ""}});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  ASSERT_EQ(std::ranges::count(done.out, '\n'), 3) << done.out;
  for (const fs::directory_entry& run : fs::directory_iterator(fetched))
    EXPECT_THAT(
        play({"--policy", run.path().filename(), "--train_dir", fetched, "--decision_limit", "20"})["each"],
        SizeIs(2));
}

TEST_F(EvaluationOfRuns, TheBestPolicyIsPackedFetchedAndPlays) {
  const std::string kept = *scratch_ / "kept", archive = *scratch_ / "policies.tar.xz",
                    fetched = *scratch_ / "fetched", name = "coop_health_gathering";
  const Environment from = {{"COMRAD_POLICIES", archive}};
  const auto fetch = [&](std::vector<std::string> words, const Environment& environment) {
    words.insert(words.begin(), {"fetch-policies", "--train_dir", fetched});
    return comrad(words, environment);
  };
  const auto pack = [&] { return comrad({"pack-policies", scratch_->string(), "--output", archive}); };
  EXPECT_THAT(pack().err, HasSubstr("is no folder of a sweep"));
  scratch_->write("sweep.json", nlohmann::json{{"results", {{"folder", kept}}}}.dump());
  EXPECT_THAT(pack().err, HasSubstr("no run there has a checkpoint and a result"));
  for (const auto& [run, score] : {std::pair{"a", 650.5}, {"b", 700.25}})
    scratch_->write(std::string("kept/") + run + "/result.json",
                    nlohmann::json{{"J_mean", score}, {"stale", ""}, {"algo", "mappo"}, {"seed", 2}}.dump());
  const Ending packed = pack();
  ASSERT_EQ(packed.exit_code, 0) << packed.err;
  EXPECT_THAT(packed.out, HasSubstr(name + ": b, J 700.2"));
  EXPECT_LT(fs::file_size(archive), fs::file_size(checkpoint("b")) / 2) << "moments were kept";

  for (int time = 0; time < 2; ++time) {  // what is there already stays
    const Ending done = fetch({}, from);
    ASSERT_EQ(done.exit_code, 0) << done.err;
    EXPECT_THAT(done.out, HasSubstr("mappo, seed 2, J 700.2"));
  }
  // Weights are rounded, so drawn actions may differ from b's; the file is what the learner makes of b's.
  const std::string expected = *scratch_ / "expected.pt", file = fs::path(checkpoint("b")).filename();
  ASSERT_EQ(RunningProgram({program("comrad-learner"), "--to_be_played", checkpoint("b"), expected,
                            fetched + "/policy_" + name + "/config.toml"})
                .wait()
                .exit_code,
            0);
  EXPECT_EQ(read_text(fetched + "/policy_" + name + "/checkpoint/" + file), read_text(expected));
  EXPECT_THAT(read_text(fetched + "/policy_" + name + "/config.toml"), Not(HasSubstr(scratch_->string())));
  const nlohmann::json result = play({"--policy", "policy_" + name, "--train_dir", fetched});
  EXPECT_THAT(result["each"], SizeIs(2));
  EXPECT_EQ(result["scenario"], name);

  for (const auto& [ending, message] : std::vector<std::pair<Ending, std::string>>{
           {fetch({}, {{"COMRAD_POLICIES", run("a")}}), "has no policies.json"},
           {fetch({}, {{"COMRAD_POLICIES", checkpoint("a")}}), "is no whole .tar.xz"},
           {fetch({"lava_pit"}, from), "there is no policy of lava_pit; there are " + name}}) {
    EXPECT_EQ(ending.exit_code, 2) << message;
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_EQ(std::ranges::count(ending.err, '\n'), 1) << ending.err;
  }
  // Unpacked, and damaged.
  const std::string unpacked = *scratch_ / "unpacked";
  fs::create_directory(unpacked);
  ASSERT_EQ(RunningProgram({"/usr/bin/python3", "-m", "tarfile", "-e", archive, unpacked}).wait().exit_code,
            0);
  std::ofstream(unpacked + "/" + name + "/config.toml", std::ios::app) << "#";
  EXPECT_THAT(fetch({name}, {{"COMRAD_POLICIES", unpacked}}).err,
              HasSubstr(name + "/config.toml is damaged: its SHA-256"));
}

TEST_F(EvaluationOfRuns, RunsOfAnotherGameAreRefusedByName) {
  const std::string larger = copy_with("larger", "num_agents", "3"),
                    elsewhere = copy_with("elsewhere", "scenario", "\"lava_pit\""),
                    measured = copy_with("measured", "use_additional_input", "true");
  expect_refused({"--policy", run("a"), "--policy", larger},
                 {"run " + larger, "num_agents is 3 there and 2 here"});
  expect_refused({"--seat", "0=" + run("a"), "--seat", "1=" + elsewhere},
                 {"run " + elsewhere, "scenario is lava_pit there and coop_health_gathering here"});
  expect_refused({"--cross_play", run("a") + "," + measured},
                 {"run " + measured, "use_additional_input is true there and false here"});
  expect_refused({"--policy", run("a"), "--num_agents", "3"}, {"the run was made with 2"});
  // Their checkpoints say the same of themselves.
  expect_refused({"--policy", measured, "--checkpoint", checkpoint("a")},
                 {checkpoint("a"), "use_additional_input is false there and true here"});
  expect_refused({"--policy", run("a"), "--seat", "1=" + elsewhere + "/checkpoint/none.pt"},
                 {"no checkpoint"});
}

TEST(EvaluationWhileTraining, EveryPointOnceAndTheLastOneToo) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  const Ending first = RunningProgram(evaluated_training(scratch, 4096)).wait(kBackgroundSeconds);
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
  const auto request = [&](const std::string& file, int env_frames, const char* bytes) {
    std::ofstream(run + "/checkpoint/evaluations.jsonl", std::ios::app)
        << nlohmann::json{{"file", file}, {"version", 1}, {"env_frames", env_frames}, {"train_seconds", 1}}
        << "\n";
    std::ofstream(run + "/checkpoint/" + file) << bytes;
  };
  request("evaluate_1.pt", 4100, "an old one");
  request("evaluate_9.pt", 9000, "no checkpoint");
  const Ending second = RunningProgram(evaluated_training(scratch, 12288)).wait(kBackgroundSeconds);
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
                                   files(run + "/checkpoint", "milestone_")[0], "--episodes", "1", "--json"});
  EXPECT_EQ(milestone.exit_code, 0) << milestone.err;
}

TEST(EvaluationWhileTraining, VideosShowThePolicyAndAResumedRunContinuesThem) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  const auto train = [&](double env_frames) {
    const Ending ending =
        RunningProgram(small_training(scratch, "run", env_frames, {"--video_every_env_frames", "4096"}))
            .wait(kBackgroundSeconds);
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    return ending.err;
  };
  EXPECT_THAT(train(4096), HasSubstr("recorded a video at 4."));
  const std::vector<std::string> first = files(run + "/videos", "video_");
  ASSERT_THAT(first, SizeIs(1));
  // An untrained team survives some 640 tics, 18 s; the last picture stands for a second.
  EXPECT_NEAR(gif_seconds(first[0]), 19, 1.5);
  const std::vector<std::string> events = files(run + "/eval", "events.out.tfevents.");
  ASSERT_THAT(events, SizeIs(1));
  EXPECT_THAT(read_text(events[0]), AllOf(HasSubstr("eval/video"), HasSubstr(read_text(first[0]))));
  EXPECT_THAT(evaluations(run), IsEmpty()) << "no score was requested";
  EXPECT_THAT(files(run + "/checkpoint", "evaluate_"), IsEmpty());

  EXPECT_THAT(train(8192), AllOf(HasSubstr("recorded a video at 8."), Not(HasSubstr("video at 4."))));
  EXPECT_THAT(files(run + "/videos", "video_"), SizeIs(2));
  EXPECT_FALSE(fs::exists(run + "/.evaluation"));
  EXPECT_TRUE(processes_of(run).empty());
}

TEST(EvaluationWhileTraining, NothingIsLeftWhenTheRunIsKilled) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  std::vector<std::string> command = evaluated_training(scratch, 1e8);
  command.insert(command.end(), {"--eval_episodes", "100000"});
  RunningProgram training(command);
  const auto evaluators = [&] { return processes_of(run + "/.evaluation", "comrad-sim-worker"); };
  ASSERT_TRUE(wait_until([&] { return !evaluators().empty(); }));
  kill(training.pid(), SIGKILL);
  EXPECT_TRUE(wait_until([&] { return processes_of(run).empty(); }));
  training.wait();

  // A resumed run clears what it left, plays the point that was given up, and ends with Ctrl-C as any other.
  RunningProgram again(command);
  ASSERT_TRUE(wait_until([&] { return !evaluators().empty(); }));
  again.signal(SIGTERM);
  const Ending ending = again.wait();
  EXPECT_FALSE(ending.timed_out);
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_TRUE(wait_until([&] { return processes_of(run).empty(); }));
  EXPECT_THAT(files(run + "/checkpoint", "evaluate_"), Not(IsEmpty())) << "the next start continues with it";
}

}  // namespace evaluation_test
}  // namespace comrad::test
