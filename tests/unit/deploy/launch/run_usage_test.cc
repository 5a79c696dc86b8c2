#include "deploy/launch/run_usage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "rollout_buffer/core/clock.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/small_arena.h"

namespace comrad::deploy {
namespace run_usage_test {

using ::testing::DoubleNear;
using ::testing::ElementsAre;

TEST(CoreSeconds, CountsWorkOfTheNamedCoresAndNoWaits) {
  ASSERT_EQ(sysconf(_SC_CLK_TCK), 100);
  const std::string text =
      "cpu  999 999 999 999 999 999 999 0 0 0\n"
      "cpu0 100 20 30 5000 600 4 6 77 0 0\n"
      "cpu1 200 0 0 5000 0 0 0 0 0 0\n"
      "cpu10 900 0 0 0 0 0 0 0 0 0\n"
      "intr 1 2 3\n";
  EXPECT_THAT(core_seconds(text, std::vector{1, 0, 7}),
              ElementsAre(DoubleNear(2, 1e-9), DoubleNear(1.6, 1e-9), 0));
  EXPECT_THAT(core_seconds("", std::vector{0}), ElementsAre(0));
}

/// What a worker of the run counts in one stage.
void write_stage(const test::ScratchFolder& run_dir, const std::string& name, uint64_t pid, Stage stage,
                 uint64_t ns, uint64_t bytes) {
  std::array<uint64_t, 2 + 2 * kStageCount> words{};
  words.front() = pid;
  words[1 + static_cast<std::size_t>(stage)] = ns;
  words[1 + kStageCount + static_cast<std::size_t>(stage)] = 2 * ns;
  words.back() = bytes;
  std::ofstream(run_dir / (std::string(kStagesFolder) + "/" + name), std::ios::binary)
      .write(reinterpret_cast<const char*>(words.data()), sizeof words);
}

TEST(ReadUsage, AddsUpWhatWorkersCountByRole) {
  const test::ScratchFolder run_dir;
  const shm::Arena arena = *shm::Arena::create(test::small_arena_shape(), 1);
  arena.sim_counters(0).wait_ns = 1'000'000'000;
  arena.sim_counters(1).wait_ns = 2'000'000'000;
  arena.learner_counters().wait_ns = 500'000'000;
  EXPECT_EQ(read_usage(run_dir.string(), arena).cpu_s(), 0) << "no counters";

  std::filesystem::create_directory(run_dir / kStagesFolder);
  write_stage(run_dir, "sim-0", static_cast<uint64_t>(getpid()), Stage::kTic, 3'000'000'000, 10);
  write_stage(run_dir, "sim-1", 999'999'999, Stage::kTic, 1'000'000'000, 5);
  write_stage(run_dir, "learner-0", 999'999'999, Stage::kOptimizer, 250'000'000, 100);
  const double cpu_s_before = process_cpu_s();
  const RunUsage usage = read_usage(run_dir.string(), arena);
  EXPECT_DOUBLE_EQ(usage.of(Stage::kTic), 4);
  EXPECT_DOUBLE_EQ(usage.stage_wall_s[static_cast<std::size_t>(Stage::kTic)], 8);
  EXPECT_DOUBLE_EQ(usage.of(Stage::kOptimizer), 0.25);
  EXPECT_EQ(usage.copied_bytes, 115);
  EXPECT_DOUBLE_EQ(usage.sims.wait_s, 3);
  EXPECT_EQ(usage.sims.processes, 2);
  EXPECT_EQ(usage.policy_workers.processes, 1);
  constexpr double kTick_s = 0.02;  // two of the kernel's
  EXPECT_GE(usage.sims.cpu_s, cpu_s_before - kTick_s) << "this process's; the other one is gone";
  EXPECT_LE(usage.sims.cpu_s, process_cpu_s() + kTick_s);
  EXPECT_EQ(usage.learner.cpu_s, 0);
  ASSERT_FALSE(usage.core_busy_s.empty());
  EXPECT_GT(usage.core_busy_s[0], 0);
}

TEST(ReadUsage, PolicyWorkersThatAreThreadsOfALearnerAreNotItsTime) {
  const test::ScratchFolder run_dir;
  const shm::Arena arena = *shm::Arena::create(test::small_arena_shape(), 1);
  std::filesystem::create_directory(run_dir / kStagesFolder);
  write_stage(run_dir, "learner-0", static_cast<uint64_t>(getpid()), Stage::kForward, 10'000'000, 0);
  while (process_cpu_s() < 0.05) continue;
  const RunUsage usage = read_usage(run_dir.string(), arena);
  EXPECT_DOUBLE_EQ(usage.policy_workers.cpu_s, 0.01);
  EXPECT_GT(usage.learner.cpu_s, 0.02);
}

TEST(UsageBetween, IsTheDifferenceAndNeverBelowZero) {
  RunUsage before, after;
  before.stage_cpu_s[0] = 1, after.stage_cpu_s[0] = 3;
  before.stage_cpu_s[1] = 5, after.stage_cpu_s[1] = 2;
  before.stage_wall_s[2] = 1, after.stage_wall_s[2] = 4;
  before.copied_bytes = 10, after.copied_bytes = 30;
  before.sims = {.cpu_s = 1, .wait_s = 2, .processes = 2},
  after.sims = {.cpu_s = 4, .wait_s = 2.5, .processes = 2};
  before.core_busy_s = {1, 2}, after.core_busy_s = {2, 2.5};
  const RunUsage between = usage_between(before, after);
  EXPECT_EQ(between.stage_cpu_s[0], 2);
  EXPECT_EQ(between.stage_cpu_s[1], 0) << "a worker that died";
  EXPECT_EQ(between.stage_wall_s[2], 3);
  EXPECT_EQ(between.copied_bytes, 20);
  EXPECT_EQ(between.cpu_s(), 3);
  EXPECT_EQ(between.sims.wait_s, 0.5);
  EXPECT_EQ(between.sims.processes, 2);
  EXPECT_THAT(between.core_busy_s, ElementsAre(1, 0.5));
}

}  // namespace run_usage_test
}  // namespace comrad::deploy
