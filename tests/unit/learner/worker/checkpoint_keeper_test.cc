#include "learner/worker/checkpoint_keeper.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "rollout_buffer/metrics/learner_messages.h"
#include "tests/support/scratch_folder.h"

namespace comrad::learn {
namespace checkpoint_keeper_test {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(Milestones, AreTheMultiplesThatWerePassed) {
  Milestones milestones(1000);
  EXPECT_FALSE(milestones.pass(0));
  EXPECT_FALSE(milestones.pass(999));
  EXPECT_TRUE(milestones.pass(1000));
  EXPECT_FALSE(milestones.pass(1001));
  EXPECT_TRUE(milestones.pass(5500)) << "several at once are one";
  EXPECT_FALSE(milestones.pass(5999));
  milestones.start_from(7200);
  EXPECT_FALSE(milestones.pass(7999));
  EXPECT_TRUE(milestones.pass(8000));
  Milestones none(0);
  EXPECT_FALSE(none.pass(1e9));
}

class CheckpointKeeperTest : public ::testing::Test {
 protected:
  CheckpointKeeper keeper() {
    CheckpointKeeper made(config_, folder_.string(), totals_, episodes_);
    CheckpointContents contents;
    contents.state = [] {
      StateDict state;
      state.put("counters/env_frames", int64_t{1});
      return state;
    };
    contents.was_saved = [] {};
    made.write(std::move(contents));
    return made;
  }
  /// So many versions, each after `env_frames` more.
  void learn(CheckpointKeeper& made, uint64_t versions, uint64_t env_frames) {
    for (uint64_t version = 1; version <= versions; ++version) {
      totals_.env_frames = env_frames * version;
      made.save_if_due(version, 0);
    }
  }
  std::vector<std::string> saved(const std::string& begin) const {
    std::vector<std::string> names;
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "checkpoint", ignored))
      if (entry.path().filename().string().starts_with(begin)) names.push_back(entry.path().filename());
    std::ranges::sort(names);
    return names;
  }

  const test::ScratchFolder folder_;
  RunConfig config_;
  RunTotals totals_;
  EpisodeWindow episodes_{10};
};

TEST_F(CheckpointKeeperTest, MilestonesStayBesideTheLastOnes) {
  config_.run.save_milestones_env_frames = 1000;
  config_.run.keep_checkpoints = 1;
  CheckpointKeeper made = keeper();
  for (uint64_t version = 1; version <= 5; ++version) {
    totals_.env_frames = 600 * version;
    made.save_if_due(version, /*request=*/static_cast<uint32_t>(version));  // a periodic one each time
  }
  EXPECT_THAT(saved("checkpoint_"), ElementsAre("checkpoint_000000005_3000.pt"));
  EXPECT_THAT(saved("milestone_"), ElementsAre("milestone_000000002_1200.pt", "milestone_000000004_2400.pt",
                                               "milestone_000000005_3000.pt"));
  EXPECT_THAT(saved("evaluate_"), IsEmpty());
}

TEST_F(CheckpointKeeperTest, MilestonesBySecondsCountTheWholeTraining) {
  config_.run.save_milestones_sec = 3600;
  CheckpointKeeper made = keeper();
  totals_.seconds_before = 3000;
  made.save_if_due(1, 0);
  EXPECT_THAT(saved("milestone_"), IsEmpty());
  totals_.seconds_before = 3601;
  made.save_if_due(2, 0);
  made.save_if_due(3, 0);
  EXPECT_THAT(saved("milestone_"), ElementsAre("milestone_000000002_0.pt"));
}

TEST_F(CheckpointKeeperTest, WhatIsToBeEvaluatedIsSavedOnceAPoint) {
  config_.run.eval_every_env_frames = 1000;
  {
    CheckpointKeeper made = keeper();
    totals_.seconds_before = 50;
    learn(made, 4, 600);
    EXPECT_THAT(saved("evaluate_"), ElementsAre("evaluate_000000002_1200.pt", "evaluate_000000004_2400.pt"));
    const std::vector<RequestedEvaluation> requests = requested_evaluations(made.folder());
    ASSERT_EQ(requests.size(), 2u);
    EXPECT_EQ(requests[1].file, "evaluate_000000004_2400.pt");
    EXPECT_EQ(requests[1].version, 4u);
    EXPECT_EQ(requests[1].env_frames, 2400u);
    EXPECT_EQ(requests[1].train_seconds, 50u);
  }
  // The run is resumed where it stood: the points behind it are not saved again.
  CheckpointKeeper made = keeper();
  ASSERT_TRUE(made.resumed_from({.path = "checkpoint.pt", .state = {}}, 4, /*is_own=*/true));
  made.save_if_due(5, 0);
  EXPECT_EQ(saved("evaluate_").size(), 2u);
  totals_.env_frames = 3000;
  made.save_if_due(6, 0);
  EXPECT_EQ(saved("evaluate_").size(), 3u);
}

TEST_F(CheckpointKeeperTest, ScoreAndVideoOfOnePointShareACheckpoint) {
  config_.run.eval_every_env_frames = 1000;
  config_.run.video_every_env_frames = 1500;
  CheckpointKeeper made = keeper();
  learn(made, 6, 500);
  EXPECT_THAT(saved("evaluate_"), ElementsAre("evaluate_000000002_1000.pt", "evaluate_000000003_1500.pt",
                                              "evaluate_000000004_2000.pt", "evaluate_000000006_3000.pt"));
}

}  // namespace checkpoint_keeper_test
}  // namespace comrad::learn
