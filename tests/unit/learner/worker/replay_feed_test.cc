#include "learner/worker/replay_feed.h"

#include <gtest/gtest.h>

#include "tests/support/scratch_folder.h"
#include "tests/support/slab_pool.h"

namespace comrad::learn {
namespace {

using testing::SlabPool;

constexpr int kRollout = 8, kAgents = 2;

TrajectoryShape shape_of() {
  TrajectoryShape shape;
  shape.env.height = shape.env.width = 12;
  shape.env.head_count = 1;
  shape.env.head_sizes = {3};
  shape.rollout_steps = kRollout;
  shape.recurrent_state_count = 0;
  return shape;
}

RunConfig config_of() {
  RunConfig config;
  config.run.algo = "idqn";
  config.network.use_rnn = false;
  config.collection.rollout = kRollout;
  config.optimisation.batch_size = 64;
  config.q_learning.dqn_batch_decisions = 16;
  config.q_learning.learning_starts_decisions = 1000;
  config.run.train_for_env_frames = config.replay.per_beta_env_frames = 10'000;
  config.network.normalize_input = false;
  config.collection.num_workers = 1;
  config.collection.trajectory_slabs = 8;
  return config;
}

std::unique_ptr<ReplayFeed> feed_of(const RunConfig& config) {
  auto feed = ReplayFeed::create(config, shape_of(), 1 << 20);
  EXPECT_TRUE(feed) << feed.error().message;
  return std::move(*feed);
}

/// Inserts slabs until an update is due; the agent decisions that took.
int64_t decisions_before_training(ReplayFeed& feed) {
  const SlabPool pool(shape_of(), 1);
  pool.fill_with_noise(1);
  int64_t decisions = 0;
  while (!feed.is_update_due() && decisions < 5000) {
    feed.insert(pool.view(0), kRollout, 0);
    decisions += kRollout * kAgents;
  }
  return decisions;
}

/// As the learner leaves it.
StateDict checkpoint(const ReplayFeed& feed, int64_t version, int64_t env_frames) {
  StateDict state;
  state.put("algorithm/version", version);
  state.put("counters/env_frames", env_frames);
  feed.save_position(state);
  return state;
}

TEST(ReplayFeed, ATrainedPolicyWaitsForAFewBatchesOnly) {
  const auto fresh = feed_of(config_of());
  EXPECT_EQ(decisions_before_training(*fresh), 1008) << "whole slabs from learning_starts_decisions on";
  const auto resumed = feed_of(config_of());
  ASSERT_TRUE(resumed->load(checkpoint(*fresh, 7, 4032), "none", true));
  EXPECT_EQ(decisions_before_training(*resumed), 4 * 16);
  const auto foreign = feed_of(config_of());
  ASSERT_TRUE(foreign->load(checkpoint(*fresh, 7, 4032), "none", false));
  EXPECT_EQ(decisions_before_training(*foreign), 4 * 16);
  const auto untrained = feed_of(config_of());
  ASSERT_TRUE(untrained->load(checkpoint(*fresh, 0, 400), "none", true));
  EXPECT_EQ(decisions_before_training(*untrained), 1008);
  RunConfig eager = config_of();
  eager.q_learning.learning_starts_decisions = 20;
  const auto sooner = feed_of(eager);
  ASSERT_TRUE(sooner->load(checkpoint(*fresh, 7, 4032), "none", true));
  EXPECT_EQ(decisions_before_training(*sooner), 32) << "never later than a fresh run";
}

TEST(ReplayFeed, TheWeightsExponentGoesOnWhereARunIsMadeLonger) {
  const auto feed = feed_of(config_of());
  feed->set_env_frames(5000);
  EXPECT_DOUBLE_EQ(feed->beta(), 0.7);
  RunConfig longer = config_of();
  longer.run.train_for_env_frames = longer.replay.per_beta_env_frames = 30'000;
  const auto resumed = feed_of(longer);
  ASSERT_TRUE(resumed->load(checkpoint(*feed, 7, 5000), "none", true));
  EXPECT_DOUBLE_EQ(resumed->beta(), 0.7) << "at once, not with the first insert";
  resumed->set_env_frames(17'500);
  EXPECT_DOUBLE_EQ(resumed->beta(), 0.85);
  resumed->set_env_frames(30'000);
  EXPECT_DOUBLE_EQ(resumed->beta(), 1);
}

TEST(ReplayFeed, ADeterministicRunResumesWithTheCapacityItBeganWith) {
  const test::ScratchFolder folder;
  RunConfig config = config_of();
  config.collection.deterministic = true;
  config.replay.replay_gb = 1e-3;
  config.replay.replay_compress = Compress::kFalse;
  const auto feed = feed_of(config);
  decisions_before_training(*feed);
  StateDict state = checkpoint(*feed, 1, 4032);
  ASSERT_TRUE(feed->save(state, folder.string(), "replay.bin"));
  config.replay.replay_gb = 2e-3;  // stands for another amount of free memory
  config.replay.replay_compress = Compress::kTrue;
  const auto resumed = feed_of(config);
  const Status loaded = resumed->load(state, folder.string(), true);
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(resumed->replay().capacity_bytes(), feed->replay().capacity_bytes());
  EXPECT_EQ(resumed->replay().options().store.compress, feed->replay().options().store.compress);
  EXPECT_EQ(resumed->replay().transition_count(), feed->replay().transition_count());
  EXPECT_TRUE(resumed->is_update_due());
}

}  // namespace
}  // namespace comrad::learn
