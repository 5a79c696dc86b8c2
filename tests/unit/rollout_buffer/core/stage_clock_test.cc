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

// One test: a process asks for its counters once.
TEST(StageClock, CountsOnlyWhereTheFolderIsThereAndOthersReadIt) {
  const test::ScratchFolder scratch;
  const std::string folder = scratch / "stages";
  ASSERT_TRUE(share_stages(folder, "sim-0"));
  EXPECT_EQ(stage_counters(), nullptr) << "nobody made the folder";
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
  clock.begin();
  work(0.02);
  clock.end(Stage::kTic);
  work(0.01);
  clock.end(Stage::kRender);
  usleep(20'000);
  clock.end(Stage::kHandOver);
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
  const std::vector<StageTotals> all = read_stages(folder);
  ASSERT_EQ(all.size(), 1u) << "a file that is too short is left out";
  EXPECT_EQ(all[0].name, "sim-0");
  EXPECT_EQ(all[0].pid, static_cast<uint64_t>(getpid()));
  EXPECT_EQ(all[0].copied_bytes, 120u);
  EXPECT_NEAR(seconds_of(all[0], Stage::kTic), 0.02, 0.01);
  EXPECT_NEAR(seconds_of(all[0], Stage::kRender), 0.01, 0.008);
  EXPECT_LT(seconds_of(all[0], Stage::kHandOver), 0.005) << "sleep takes no processor time";
  EXPECT_NEAR(seconds_of(all[0], Stage::kCollate), 0.02, 0.01);
  EXPECT_NEAR(seconds_of(all[0], Stage::kForwardBackward), 0.02, 0.01) << "the collating thread's is its own";

  // A border is cheap beside the work between two: thousands of cycles, not millions.
  const double began_s = thread_cpu_s();
  for (int i = 0; i < 1000; ++i) clock.end(Stage::kTic);
  EXPECT_LT(thread_cpu_s() - began_s, 0.02) << "20 us a border";
}

TEST(NameOf, EveryStageHasOneOfItsOwn) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < kStageCount; ++i) names.emplace_back(name_of(static_cast<Stage>(i)));
  std::ranges::sort(names);
  EXPECT_EQ(std::ranges::unique(names).size(), 0u);
}

}  // namespace stage_clock_test
}  // namespace comrad
