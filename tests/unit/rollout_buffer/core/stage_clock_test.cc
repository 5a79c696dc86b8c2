#include "rollout_buffer/core/stage_clock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <thread>

#include "tests/support/scratch_folder.h"

namespace comrad {
namespace stage_clock_test {

void work(double seconds) {
  for (const double end_s = thread_cpu_s() + seconds; thread_cpu_s() < end_s;) {
  }
}

double seconds_of(const StageTotals& totals, Stage stage) {
  return 1e-9 * static_cast<double>(totals.cpu_ns[static_cast<std::size_t>(stage)]);
}

double wall_seconds_of(const StageTotals& totals, Stage stage) {
  return 1e-9 * static_cast<double>(totals.wall_ns[static_cast<std::size_t>(stage)]);
}

// One test: a process requests its counters once.
TEST(StageClock, CountsOnlyWhereTheFolderIsThereAndOthersReadIt) {
  const test::ScratchFolder scratch;
  const std::string folder = scratch / "stages";
  ASSERT_TRUE(share_stages(folder, "sim-0"));
  EXPECT_EQ(stage_counters(), nullptr) << "the folder does not exist";
  EXPECT_FALSE(std::filesystem::exists(folder));
  {
    StageClock clock;
    clock.begin();
    clock.end(Stage::kTic);
    count_copied(7);
    const ProcessStage stage(Stage::kForward);
  }
  EXPECT_TRUE(read_stages(folder).empty());

  std::filesystem::create_directory(folder);
  std::ofstream(folder + "/torn") << "x";
  ASSERT_TRUE(share_stages(folder, "sim-0"));
  ASSERT_NE(stage_counters(), nullptr);
  count_copied(100);
  count_copied(20);
  StageClock clock;
  work(0.01);
  const double began_s = thread_cpu_s();
  clock.begin();
  work(0.02);
  clock.end(Stage::kTic);
  const double tic_over_s = thread_cpu_s();
  work(0.01);
  clock.end(Stage::kRender);
  const double render_over_s = thread_cpu_s();
  usleep(20'000);
  clock.end(Stage::kHandOver);
  usleep(10'000);
  clock.end_wall(Stage::kForward);
  const double hand_over_over_s = thread_cpu_s();
  const double process_began_s = process_cpu_s();
  {
    const ProcessStage outer(Stage::kForwardBackward, {Stage::kCollate});
    std::thread helper([] { work(0.02); });
    std::thread collating([] {
      StageClock own;
      own.begin();
      work(0.02);
      own.end(Stage::kCollate);
    });
    helper.join();
    collating.join();
  }
  const double process_s = process_cpu_s() - process_began_s;
  const std::vector<StageTotals> all = read_stages(folder);
  ASSERT_EQ(all.size(), 1u) << "a file that is too short is left out";
  EXPECT_EQ(all[0].name, "sim-0");
  EXPECT_EQ(all[0].pid, static_cast<uint64_t>(getpid()));
  EXPECT_EQ(all[0].copied_bytes, 120u);
  // What the thread or the process used around a stage is never less than what the stage was given.
  constexpr double kRounding_s = 1e-6;
  const auto expect_between = [&](Stage stage, double least_s, double most_s) {
    EXPECT_GE(seconds_of(all[0], stage), least_s - kRounding_s) << name_of(stage);
    EXPECT_LE(seconds_of(all[0], stage), most_s + kRounding_s) << name_of(stage);
  };
  EXPECT_GE(wall_seconds_of(all[0], Stage::kTic), seconds_of(all[0], Stage::kTic) - kRounding_s);
  EXPECT_GE(wall_seconds_of(all[0], Stage::kHandOver), 0.02) << "waits count";
  EXPECT_GE(wall_seconds_of(all[0], Stage::kForward), 0.01);
  EXPECT_EQ(seconds_of(all[0], Stage::kForward), 0) << "a ProcessStage counts it";
  expect_between(Stage::kTic, 0.02, tic_over_s - began_s);
  expect_between(Stage::kRender, 0.01, render_over_s - began_s - 0.02);
  expect_between(Stage::kHandOver, 0, hand_over_over_s - tic_over_s - 0.01);
  expect_between(Stage::kCollate, 0.02, process_s - 0.02);
  expect_between(Stage::kForwardBackward, 0.02, process_s - seconds_of(all[0], Stage::kCollate));
}

TEST(NameOf, EveryStageHasASeparateOne) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < kStageCount; ++i) names.emplace_back(name_of(static_cast<Stage>(i)));
  std::ranges::sort(names);
  EXPECT_EQ(std::ranges::unique(names).size(), 0u);
}

}  // namespace stage_clock_test
}  // namespace comrad
