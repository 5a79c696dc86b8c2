#include "rollout_buffer/replay/replay_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/replay/trajectory_store.h"

namespace comrad::replay {
namespace replay_plan_test {

using ::testing::HasSubstr;

constexpr int64_t kGigabyte = 1'000'000'000;

/// Single decisions of two agents with frames of 27.6 KB: 1 M of them take some 29 GB.
TrajectoryShape shape_of() {
  TrajectoryShape shape;
  shape.env.head_sizes = {3, 3, 2};
  return shape;
}

RunConfig config_of(double replay_gb) {
  RunConfig config;
  config.run.algo = "vdn";
  config.network.use_rnn = false;
  config.replay.replay_gb = replay_gb;
  return config;
}

ReplayPlan plan_of(const RunConfig& config, double memory_gb, double disk_gb = 0) {
  const auto plan = replay_plan(config, shape_of(),
                                {.memory_bytes = static_cast<int64_t>(memory_gb * 1e9),
                                 .disk_bytes = static_cast<int64_t>(disk_gb * 1e9)},
                                kGigabyte, "train_dir/run");
  EXPECT_TRUE(plan) << plan.error().message;
  return plan ? *plan : ReplayPlan();
}

TEST(ReplayPlan, TakesAThirdOfFreeMemoryAndCompressesWhereThatIsTooLittle) {
  const ReplayPlan plan = plan_of(config_of(0), 10);
  EXPECT_EQ(plan.capacity_bytes, 3 * kGigabyte);
  EXPECT_EQ(plan.capacity_transitions, 1'000'000);
  EXPECT_TRUE(plan.compress);
  EXPECT_EQ(plan.file, "");
  EXPECT_THAT(plan.reason, HasSubstr("LZ4 on"));
}

TEST(ReplayPlan, ReportsHowManyDecisionsFitAndWhenLearningBegins) {
  RunConfig config = config_of(0.05);
  config.q_learning.learning_starts_decisions = 50'000;
  const ReplayPlan little = plan_of(config, 10);
  EXPECT_GT(little.fitting_decisions, 1000);
  EXPECT_LT(little.fitting_decisions, 50'000'000 / (3 * 72 * 128));
  EXPECT_EQ(little.decisions_before_training, little.fitting_decisions / 2) << "50 000 are never there";
  const auto store = TrajectoryStore::create(
      {.shape = shape_of(), .capacity_bytes = little.capacity_bytes, .keep_recurrent_state = false});
  ASSERT_TRUE(store);
  EXPECT_EQ(store->capacity_transitions(), little.fitting_decisions);
  EXPECT_THAT(little.words(), HasSubstr("room for at least " + std::to_string(little.fitting_decisions)));
  EXPECT_THAT(little.words(),
              HasSubstr("learning begins with " + std::to_string(little.decisions_before_training)));
  config.q_learning.learning_starts_decisions = 500;
  EXPECT_EQ(plan_of(config, 10).decisions_before_training, 500);
  EXPECT_EQ(plan_of(config_of(0), 200).fitting_decisions, 1'000'000);
}

TEST(ReplayPlan, TakesNoMoreThanTheDecisionsNeed) {
  const ReplayPlan plan = plan_of(config_of(0), 200);
  EXPECT_FALSE(plan.compress);
  const double needed = 1e6 * 3 * 72 * 128;
  EXPECT_GT(static_cast<double>(plan.capacity_bytes), needed);
  EXPECT_LT(static_cast<double>(plan.capacity_bytes), 1.2 * needed);
  // A store of that size holds them, short trajectories and masks apart.
  RunConfig small = config_of(0);
  small.replay.replay_capacity_decisions = 2000;
  const ReplayPlan little = plan_of(small, 10);
  const auto store = TrajectoryStore::create({.shape = shape_of(), .capacity_bytes = little.capacity_bytes});
  ASSERT_TRUE(store);
  EXPECT_GE(store->capacity_transitions(), 2000);
}

TEST(ReplayPlan, ATypedSizeStaysInMemoryWhileThereIsRoom) {
  const ReplayPlan plan = plan_of(config_of(4), 10, 100);
  EXPECT_EQ(plan.capacity_bytes, 4 * kGigabyte);
  EXPECT_EQ(plan.file, "");
  EXPECT_TRUE(plan.compress) << "a million decisions do not fit into 4 GB as they are";
  EXPECT_EQ(plan_of(config_of(0.01), 0.5, 100).file, "") << "a small one, where little is free";
}

TEST(ReplayPlan, MoreThanMemoryGoesToAFileOfTheRun) {
  const ReplayPlan plan = plan_of(config_of(20), 10, 100);
  EXPECT_EQ(plan.capacity_bytes, 20 * kGigabyte);
  EXPECT_EQ(plan.file, "train_dir/run/replay.ring");
  EXPECT_THAT(plan.reason, HasSubstr("train_dir/run/replay.ring"));
  EXPECT_LT(plan_of(config_of(90), 10, 100).capacity_bytes, 40 * kGigabyte)
      << "no more than the decisions need";
  const auto none = replay_plan(config_of(20), shape_of(),
                                {.memory_bytes = 10 * kGigabyte, .disk_bytes = 5 * kGigabyte}, 0, "x");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kNoSpace);
  EXPECT_THAT(none.error().message, HasSubstr("--replay_gb"));
}

TEST(ReplayPlan, ANamedFileAndATypedChoiceOfCompressionHold) {
  RunConfig config = config_of(2);
  config.replay.replay_file = "/disk/ring";
  config.replay.replay_compress = Compress::kFalse;
  const ReplayPlan plan = plan_of(config, 10, 100);
  EXPECT_EQ(plan.file, "/disk/ring");
  EXPECT_FALSE(plan.compress);
  config.replay.replay_gb = 0;
  config.replay.replay_compress = Compress::kTrue;
  EXPECT_EQ(plan_of(config, 10, 30).capacity_bytes, 10 * kGigabyte) << "a third of the disk";
  EXPECT_TRUE(plan_of(config, 10, 30).compress);
}

TEST(ReplayPlan, IsSharedOutToLearnersWhoseProgramsTakeMemoryToo) {
  RunConfig config = config_of(2);
  config.replay.replay_file = "/disk/ring";
  const ReplayPlan plan = plan_of(config, 10, 100), first = plan.share_of(0, 4), last = plan.share_of(3, 4);
  EXPECT_EQ(first.capacity_bytes, kGigabyte / 2);
  EXPECT_EQ(last.capacity_bytes, kGigabyte / 2);
  EXPECT_EQ(last.capacity_transitions, 250'000);
  EXPECT_EQ(first.file, "/disk/ring");
  EXPECT_EQ(last.file, "/disk/ring.3");
  EXPECT_EQ(last.decisions_before_training, plan.decisions_before_training) << "of all of them";
  RunConfig four = config;
  four.collection.learners = 4;
  EXPECT_GT(reserved_bytes(four, shape_of(), 1 << 20),
            reserved_bytes(config, shape_of(), 1 << 20) + kGigabyte);
}

TEST(ReplayPlan, LooksAtAFolderThatIsNotThereYet) {
  const HostSpace space = probe_space("/tmp/no/such/folder/yet");
  EXPECT_GT(space.memory_bytes, 0);
  EXPECT_EQ(probe_space("/tmp").disk_bytes > 0, space.disk_bytes > 0);
  EXPECT_GT(reserved_bytes(config_of(0), shape_of(), 1 << 20), 0);
}

}  // namespace replay_plan_test
}  // namespace comrad::replay
