#include "learner/sources/replay_feed.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "tests/support/in_ranks.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/slab_pool.h"

namespace comrad::learn {
namespace replay_feed_test {

using test::in_ranks;
using test::SlabPool;

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
  config.q_learning.replay_batch_size = 16;
  config.q_learning.learning_starts_decisions = 1000;
  config.run.train_for_env_frames = config.replay.per_beta_env_frames = 10'000;
  config.network.normalize_input = false;
  config.collection.num_workers = 1;
  config.collection.trajectory_slabs = 8;
  return config;
}

std::unique_ptr<ReplayFeed> feed_of(const RunConfig& config, RankGroup* ranks = nullptr) {
  auto feed = ReplayFeed::create(config, shape_of(), 1 << 20, "", torch::kCPU, ranks);
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

TEST(ReplayFeed, TheWeightsExponentContinuesWhereARunIsMadeLonger) {
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

TEST(ReplayFeed, NStepFollowsTheEnvFrames) {
  RunConfig config = config_of();
  config.q_learning.n_step = Schedule::line(5, 2, 3000);
  const auto feed = feed_of(config);
  const SlabPool pool(shape_of(), 1);
  pool.fill_with_noise(1);
  for (int i = 0; i < 64; ++i) feed->insert(pool.view(0), kRollout, 0);
  for (const auto& [env_frames, n_step] : {std::pair(0.0, 5), {1000.0, 4}, {9000.0, 2}}) {
    feed->set_env_frames(env_frames);
    const auto batch = feed->sample();
    // Noise has no ends: only a trajectory's own end makes a target shorter.
    EXPECT_NEAR(batch->bootstrap.min().item<double>(), std::pow(config.optimisation.gamma, n_step - 1), 1e-6)
        << env_frames;
  }
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

/// Inserts `count` slabs of noise, and reports to the others.
Inserted insert(ReplayFeed& feed, int count, uint64_t seed) {
  const SlabPool pool(shape_of(), 1);
  pool.fill_with_noise(seed);
  for (int i = 0; i < count; ++i) feed.insert(pool.view(0), kRollout, 0);
  return feed.take_inserted();
}

constexpr int kSlab = kRollout * kAgents;

TEST(TwoReplays, KeepOnePaceByWhatCameIntoBoth) {
  RunConfig config = config_of();
  config.collection.learners = 2;
  config.replay.replay_capacity_decisions = 4000;
  in_ranks(2, [&](RankGroup& ranks) {
    const bool is_first = ranks.is_leader();
    const auto feed = feed_of(config, &ranks);
    feed->agree_on_pace();
    EXPECT_EQ(feed->replay().options().store.capacity_transitions, 2000);
    // More than training waits for; but one replay has none yet.
    Inserted taken = insert(*feed, is_first ? 63 : 0, 1);
    EXPECT_EQ(taken.transitions, 63 * kSlab) << "of both";
    EXPECT_EQ(feed->filled(), 1);
    EXPECT_FALSE(feed->is_update_due());
    taken = insert(*feed, is_first ? 0 : 1, 2);
    EXPECT_EQ(taken.transitions, kSlab);
    EXPECT_EQ(feed->contents().transitions, 64 * kSlab);
    EXPECT_EQ(feed->contents().broken_decisions, 0);
    int updates = 0;
    for (; feed->is_update_due(); ++updates) {
      const std::unique_ptr<ReplayBatch> batch = feed->sample();
      EXPECT_EQ(batch->world_count, 8) << "half of 16";
      EXPECT_NEAR(batch->least_probability, 1.0 / (is_first ? 63 * kSlab : kSlab), 1e-9);
    }
    EXPECT_GT(updates, 0);
    const std::vector<double> of_both = ranks.add_up({static_cast<double>(updates)});
    EXPECT_EQ(of_both[0], 2 * updates) << "as often in both";
    EXPECT_FALSE(ranks.failure());
  });
}

TEST(TwoReplays, AreSavedBesideEachOtherAndLoadedByAsManyLearners) {
  const test::ScratchFolder folder;
  RunConfig config = config_of();
  config.replay.save_replay = true;
  config.collection.learners = 2;
  StateDict state;
  in_ranks(2, [&](RankGroup& ranks) {
    const auto feed = feed_of(config, &ranks);
    insert(*feed, ranks.rank() == 0 ? 40 : 30, 1);
    if (ranks.is_leader()) {
      state = checkpoint(*feed, 1, 4032);
      EXPECT_TRUE(feed->save(state, folder.string(), "replay_1_4032.bin"));
      feed->meet_before_drain();
    } else {
      feed->meet_before_drain();  // saves, and continues
    }
  });
  in_ranks(2, [&](RankGroup& ranks) {
    const auto feed = feed_of(config, &ranks);
    ASSERT_TRUE(feed->load(state, folder.string(), true));
    EXPECT_EQ(feed->replay().transition_count(), (ranks.rank() == 0 ? 40 : 30) * kSlab);
    feed->agree_on_pace();
    insert(*feed, 1, 2);
    EXPECT_TRUE(feed->is_update_due()) << "72 slabs are more than training waits for";
  });
  // One has lost its file: both count anew.
  std::filesystem::remove(folder / "replay_1_4032.1.bin");
  in_ranks(2, [&](RankGroup& ranks) {
    const auto feed = feed_of(config, &ranks);
    ASSERT_TRUE(feed->load(state, folder.string(), true));
    feed->agree_on_pace();
    insert(*feed, 1, 2);
    EXPECT_FALSE(feed->is_update_due());
    insert(*feed, 1, 3);
    EXPECT_TRUE(feed->is_update_due()) << "four batches of 16";
  });
  const auto one = feed_of(config_of());
  ASSERT_TRUE(one->load(state, folder.string(), true));
  EXPECT_EQ(one->replay().transition_count(), 0) << "another number of learners";
}

TEST(TwoReplays, AFeedThatIsToSaveAfterOthersLeftHasNoReplayToName) {
  const test::ScratchFolder folder;
  RunConfig config = config_of();
  config.replay.save_replay = true;
  in_ranks(2, [&](RankGroup& ranks) {
    const auto feed = feed_of(config, &ranks);
    ranks.leave({ErrorCode::kTimeout, "the run stops"});
    if (!ranks.is_leader()) return;
    StateDict state;
    EXPECT_TRUE(feed->save(state, folder.string(), "replay_1_4032.bin"));
    EXPECT_FALSE(state.has("replay/file"));
  });
}

}  // namespace replay_feed_test
}  // namespace comrad::learn
