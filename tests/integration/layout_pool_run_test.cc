// Training on a pool of layouts: simulators change layouts, the curriculum hears of every episode, its state
// survives a resume, lock step stays bit-identical, and evaluation plays other layouts in turn.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <torch/torch.h>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <set>
#include <variant>

#include "learner/checkpoint/checkpoint.h"
#include "tests/integration/running_program.h"

namespace comrad::test {
namespace layout_pool_run_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr int kExitBadInput = 2;

/// Two agents that press at random die of hunger after about 160 decisions; every episode plays
/// another layout.
std::vector<std::string> training(const ScratchFolder& scratch, const std::string& experiment,
                                  double env_steps, const std::string& pool,
                                  const std::vector<std::string>& more = {}) {
  std::vector<std::string> all = {"--layout_pool", pool, "--layout_swap_every", "1"};
  all.insert(all.end(), more.begin(), more.end());
  return small_training(scratch, experiment, env_steps, all);
}

std::string train(const ScratchFolder& scratch, const std::string& experiment, double env_steps,
                  const std::string& pool, const std::vector<std::string>& more = {}) {
  const Ending ending = RunningProgram(training(scratch, experiment, env_steps, pool, more)).wait();
  EXPECT_FALSE(ending.timed_out) << ending.err;
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  return ending.err;
}

std::string make_pool(const ScratchFolder& scratch, const std::string& kind, int count) {
  const std::string folder = scratch / ("pool_" + kind + std::to_string(count));
  const Ending made = comrad({"doomgen", "coop_health_gathering", "--pool", kind, "--count",
                              std::to_string(count), "--num_agents", "2", "-o", folder});
  EXPECT_EQ(made.exit_code, 0) << made.err;
  return folder;
}

nlohmann::json curriculum_state(const std::string& run) { return read_json(run + "/curriculum_state.json"); }

int64_t episodes(const nlohmann::json& state) {
  int64_t sum = 0;
  for (const auto& count : state["counts"]) sum += count.get<int64_t>();
  return sum;
}

learn::StateDict last_checkpoint(const std::string& run) {
  const auto checkpoints = learn::CheckpointStore(run + "/checkpoint", 1).list();
  EXPECT_FALSE(checkpoints.empty()) << run;
  if (checkpoints.empty()) return {};
  auto state = learn::read_checkpoint(checkpoints.front().path);
  EXPECT_TRUE(state) << state.error().message;
  return state ? *state : learn::StateDict();
}

/// Compares what training made and what the curriculum recorded; returns how many values were compared.
size_t expect_same_run(const std::string& run_a, const std::string& run_b) {
  const learn::StateDict a = last_checkpoint(run_a), b = last_checkpoint(run_b);
  size_t compared = 0;
  for (const auto& [key, value] : a.values()) {
    if (!key.starts_with("network/") && !key.starts_with("optimizer/") && !key.starts_with("curriculum/"))
      continue;
    const auto other = b.values().find(key);
    if (other == b.values().end() || other->second.index() != value.index()) {
      ADD_FAILURE() << key;
      continue;
    }
    if (const auto* tensor = std::get_if<torch::Tensor>(&value)) {
      EXPECT_TRUE(torch::equal(*tensor, std::get<torch::Tensor>(other->second))) << key;
    } else if (const auto* text = std::get_if<std::string>(&value)) {
      EXPECT_EQ(*text, std::get<std::string>(other->second)) << key;
    }
    ++compared;
  }
  return compared;
}

TEST(LayoutPoolRun, SimulatorsChangeLayoutsAndAResumeContinues) {
  const ScratchFolder scratch;
  const std::string pool = make_pool(scratch, "train", 3);
  train(scratch, "run", 28'000, pool, {"--curriculum", "learning_progress"});
  const nlohmann::json before = curriculum_state(scratch / "run");
  ASSERT_TRUE(before.is_object());
  ASSERT_EQ(before["tasks"].size(), 3u);
  for (const auto& count : before["counts"])
    EXPECT_GT(count, 0) << "every layout was played: " << before.dump();
  EXPECT_GT(before["counter"], 8) << "more draws than environments: some changed their layout";

  const auto reports = read_json_lines(scratch / "run" / "metrics.jsonl");
  ASSERT_FALSE(reports.empty());
  for (const char* name :
       {"curriculum/entropy", "curriculum/tasks", "curriculum/layouts_seen", "curriculum/draws",
        "curriculum/episodes", "curriculum/mean_score", "curriculum/learning_progress"})
    EXPECT_TRUE(reports.back().contains(name)) << name;
  EXPECT_EQ(reports.back()["curriculum/layouts_seen"], 3);

  const std::string words = train(scratch, "run", 42'000, pool, {"--curriculum", "learning_progress"});
  EXPECT_THAT(words, HasSubstr("Resuming"));
  const nlohmann::json after = curriculum_state(scratch / "run");
  EXPECT_EQ(after["tasks"], before["tasks"]);
  EXPECT_GT(episodes(after), episodes(before));
  EXPECT_GT(after["counter"], before["counter"]) << "the draws continue where they stopped";
  for (std::size_t task = 0; task < 3; ++task) EXPECT_GE(after["counts"][task], before["counts"][task]);

  // A run continues with its pool or not at all.
  const auto refused = [&](const std::vector<std::string>& command) {
    const Ending ending = RunningProgram(command).wait();
    EXPECT_EQ(ending.exit_code, kExitBadInput) << ending.err;
    return ending.err;
  };
  EXPECT_THAT(refused(small_training(scratch, "run", 70'000, {"--layout_pool="})),
              HasSubstr("--layout_pool"));
  EXPECT_THAT(refused(training(scratch, "run", 70'000, pool, {"--curriculum", "plr"})),
              HasSubstr("curriculum"));
  const Ending other =
      RunningProgram(training(scratch, "run", 70'000, make_pool(scratch, "train", 4))).wait();
  EXPECT_NE(other.exit_code, 0);
  EXPECT_THAT(other.err, HasSubstr("its list of tasks is another one"));
}

TEST(LayoutPoolRun, LockStepIsBitIdenticalAcrossAResume) {
  const ScratchFolder scratch;
  const std::string pool = make_pool(scratch, "train", 4);
  const std::vector<std::string> lock_step = {"--deterministic=True", "--curriculum", "plr", "--plr_rho",
                                              "0.5"};
  constexpr double kEnvSteps = 12'288;
  train(scratch, "one", kEnvSteps, pool, lock_step);
  EXPECT_GT(curriculum_state(scratch / "one")["counter"], 8) << "layouts were drawn anew within the run";
  train(scratch, "resumed", kEnvSteps / 2, pool, lock_step);
  train(scratch, "resumed", kEnvSteps, pool, lock_step);
  EXPECT_GT(expect_same_run(scratch / "one", scratch / "resumed"), 20u);
}

TEST(LayoutPoolRun, APoolIsDrawnOnTheSpotAndEvaluationPlaysAnother) {
  const ScratchFolder scratch;
  train(scratch, "run", 8192, "train:3");
  EXPECT_EQ(curriculum_state(scratch / "run")["tasks"].size(), 3u);
  EXPECT_EQ(files(scratch / "run" / "layouts/coop_health_gathering_train_3", "", ".wad").size(), 3u);

  // Its evaluation plays fresh layouts that no training pool holds.
  const Ending eval =
      comrad({"eval", "--policy", scratch / "run", "--episodes", "6", "--layout_pool", "eval:3", "--json"});
  ASSERT_EQ(eval.exit_code, 0) << eval.err;
  const auto summary = nlohmann::json::parse(eval.out, nullptr, false);
  ASSERT_TRUE(summary.is_object()) << eval.out;
  EXPECT_EQ(summary["layout"], "pool eval:3");
  EXPECT_EQ(summary["layouts"], 3);
  EXPECT_TRUE(summary["J_ci95_layouts"].is_number());
  std::set<std::string> trained;
  const nlohmann::json state = curriculum_state(scratch / "run");
  for (const auto& task : state["tasks"]) trained.insert(task.get<std::string>());
  for (const auto& [layout, score] : summary["J_by_layout"].items())
    EXPECT_FALSE(trained.contains(layout)) << layout;
}

TEST(LayoutPoolRun, ACurriculumIsDrawnIntoItsRunWhichIsAskedWhatItCanOnTheScenariosOwnMap) {
  const ScratchFolder scratch;
  train(scratch, "run", 8192, "curriculum",
        {"--scenario", "stealth_labyrinth", "--curriculum", "sequential", "--num_agents", "2"});
  const nlohmann::json tasks = curriculum_state(scratch / "run")["tasks"];
  ASSERT_EQ(tasks.size(), 9u);
  EXPECT_EQ(tasks[0], "stealth_labyrinth_00_one_bullet");
  EXPECT_EQ(files(scratch / "run" / "layouts/stealth_labyrinth_curriculum", "", ".wad").size(), 9u);
  const auto played = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = {"eval", "--policy", scratch / "run", "--episodes", "2", "--json"};
    words.insert(words.end(), more.begin(), more.end());
    const Ending eval = comrad(words);
    EXPECT_EQ(eval.exit_code, 0) << eval.err;
    return nlohmann::json::parse(eval.out, nullptr, false);
  };
  EXPECT_EQ(played({})["layout"], "seed 42");
  EXPECT_EQ(played({"--maps", "train"})["layout"], "pool curriculum");
  const Ending none = RunningProgram(training(scratch, "none", 8192, "curriculum")).wait();
  EXPECT_EQ(none.exit_code, kExitBadInput);
  EXPECT_THAT(none.err,
              HasSubstr("comes with no curriculum; these do: lava_maze, platform_chain, stealth_labyrinth"));
}

TEST(LayoutPoolRun, BadPoolsAreRefusedBeforeARunIsMade) {
  const ScratchFolder scratch;
  const auto refused = [&](const std::string& pool, const std::vector<std::string>& more = {}) {
    const Ending ending = RunningProgram(training(scratch, "refused", 8192, pool, more)).wait();
    EXPECT_EQ(ending.exit_code, kExitBadInput) << ending.err;
    EXPECT_TRUE(processes_of(scratch.string()).empty());
    return ending.err;
  };
  EXPECT_THAT(refused(scratch / "nowhere"), AllOf(HasSubstr("nowhere"), HasSubstr("comrad doomgen")));
  EXPECT_THAT(refused("train:none"), HasSubstr("1 to 100000"));
  EXPECT_THAT(refused("eval:3"), HasSubstr("for evaluation"));
  EXPECT_THAT(refused(make_pool(scratch, "eval", 2)), HasSubstr("for evaluation"));
  const std::string pool = make_pool(scratch, "train", 2);
  EXPECT_THAT(refused(pool, {"--curriculum", "omnii"}), HasSubstr("omni"));
  EXPECT_THAT(refused(pool, {"--scenario", "lava_pit"}),
              HasSubstr("a map of scenario coop_health_gathering"));
  EXPECT_THAT(refused(pool, {"--wad", pool + "/x.wad"}), HasSubstr("--wad"));
  std::ofstream(pool + "/batch_registry.json", std::ios::trunc) << "[{\"id\": \"a\",";
  EXPECT_THAT(refused(pool), AllOf(HasSubstr("batch_registry.json"), HasSubstr("line 1")));
  std::ofstream(pool + "/batch_registry.json", std::ios::trunc)
      << "[{\"id\": \"a\", \"filename\": \"gone.wad\"}]";
  EXPECT_THAT(refused(pool), AllOf(HasSubstr("gone.wad"), HasSubstr("cannot be read")));
  EXPECT_FALSE(fs::exists(scratch / "refused" / "config.toml"));
}

}  // namespace layout_pool_run_test
}  // namespace comrad::test
