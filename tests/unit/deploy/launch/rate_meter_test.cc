#include "deploy/launch/rate_meter.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/learner_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "tests/support/small_arena.h"

namespace comrad::deploy {
namespace rate_meter_test {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class RateMeterTest : public ::testing::Test {
 protected:
  RateMeterTest() { plan_.config.environment.env_frameskip = 4; }

  /// What a learner in its `epoch`-th life has counted.
  void learner_says(uint64_t decisions, uint64_t updates, uint32_t epoch) {
    shm::WorkerCounters& counters = arena_.learner_counters();
    if (counters.epoch.exchange(epoch) != epoch) arena_.control().learner_decisions_before = decisions;
    counters.decisions = decisions;
    counters.batches = updates;
    counters.state = shm::WorkerState::kRunning;
    arena_.control().learner_env_frames = 4 * decisions;
  }
  void report(double lag) const {
    TrainStats report;
    report.policy_lag_mean = lag;
    arena_.learner_reports().publish(report);
  }

  shm::Arena arena_ = *shm::Arena::create(test::small_arena_shape(), 1);
  LaunchPlan plan_;
};

TEST(Growth, ACounterThatFallsIsCountedOnFromThere) {
  Growth growth;
  EXPECT_EQ(growth.see(10), 0u);
  EXPECT_EQ(growth.see(4), 6u);
  EXPECT_EQ(growth.see(9), 0u);
  EXPECT_EQ(growth.total(), 15u);
  EXPECT_EQ(growth.start_from(100), 0u);
  EXPECT_EQ(growth.see(101), 0u);
  EXPECT_EQ(growth.total(), 16u) << "91 were no work of ours";
  EXPECT_EQ(growth.seen(), 101u);
}

TEST_F(RateMeterTest, WithoutAnArenaNothingIsCounted) {
  RateMeter meter(plan_);
  EXPECT_FALSE(meter.count());
  EXPECT_FALSE(meter.take_report());
  EXPECT_EQ(meter.decisions(), 0u);
  EXPECT_EQ(meter.env_frames(), 0u);
  EXPECT_TRUE(std::isnan(meter.episode_score_mean()));
}

TEST_F(RateMeterTest, WhatAResumedLearnerBeginsWithIsNoWorkOfThisProcess) {
  RateMeter meter(plan_);
  meter.use(&arena_);
  learner_says(1000, 10, 1);
  arena_.learner_counters().state = shm::WorkerState::kStarting;
  EXPECT_FALSE(meter.count());
  EXPECT_EQ(meter.decisions_of_run(), 0u) << "a learner that is starting has not set its counters";
  arena_.learner_counters().state = shm::WorkerState::kRunning;
  EXPECT_FALSE(meter.count());
  learner_says(1064, 11, 1);
  EXPECT_FALSE(meter.count());
  EXPECT_EQ(meter.decisions(), 64u);
  EXPECT_EQ(meter.decisions_of_run(), 1064u);
  EXPECT_EQ(meter.env_frames(), 4 * 1064u);
}

TEST_F(RateMeterTest, HowFullTheReplayIsComesFromTheLearnersReport) {
  RateMeter meter(plan_);
  meter.use(&arena_);
  EXPECT_EQ(meter.replay_filled(), 1) << "no worker waits";
  for (const auto& [told, shown] :
       {std::pair(0.25, 0.25), {1.0, 1.0}, {0.0, 0.0}, {-3.0, 1.0}, {7.0, 1.0}, {std::nan(""), 1.0}}) {
    TrainStats report;
    report.replay_filled = told;
    arena_.learner_reports().publish(report);
    ASSERT_TRUE(meter.take_report());
    EXPECT_EQ(meter.replay_filled(), shown) << told;
  }
}

TEST_F(RateMeterTest, ALearnerThatGoesBackIsNoticedAndWhatItForgotIsKept) {
  RateMeter meter(plan_);
  meter.use(&arena_);
  learner_says(0, 0, 1);
  (void)meter.count();
  learner_says(1000, 10, 1);
  EXPECT_FALSE(meter.count());
  EXPECT_EQ(meter.going_back_text(), "");
  learner_says(750, 7, 2);
  EXPECT_TRUE(meter.count());
  EXPECT_EQ(meter.env_frames_lost(), 1000u);
  EXPECT_EQ(arena_.control().env_frames_lost.load(), 1000u);
  EXPECT_THAT(meter.going_back_text(), HasSubstr("went back 1k env frames to its last checkpoint"));
  EXPECT_EQ(meter.env_frames(), 3000u) << "not those of the dead one's last report";
  learner_says(800, 8, 2);
  EXPECT_FALSE(meter.count());
  EXPECT_EQ(meter.decisions(), 1050u) << "all that was trained on, also what was forgotten";

  // A fresh arena, where its counters begin anew, hears of it.
  const shm::Arena fresh = *shm::Arena::create(test::small_arena_shape(), 2);
  meter.use(&fresh);
  EXPECT_EQ(fresh.control().env_frames_lost.load(), 1000u);
}

TEST_F(RateMeterTest, UnsavedIsWhatCameAfterTheLastCheckpoint) {
  RateMeter meter(plan_);
  meter.use(&arena_);
  learner_says(1000, 10, 1);
  EXPECT_EQ(meter.unsaved_text(), "4k env frames since the run's beginning are lost");
  arena_.control().saved_env_frames = 3000;
  EXPECT_EQ(meter.unsaved_text(), "1k env frames since the one at 3k are lost");
}

TEST_F(RateMeterTest, TheWindowLastsFromUpdateToUpdateAfterTheWarmUp) {
  plan_.seconds = 2;
  plan_.warmup_seconds = 1;
  RateMeter meter(plan_);
  meter.use(&arena_);
  const auto learned = [&](uint64_t updates) {
    learner_says(64 * updates, updates, 1);
    (void)meter.count();
  };
  learned(0);
  EXPECT_FALSE(meter.measure(100)) << "no update yet";
  learned(1);
  report(7);
  (void)meter.take_report();
  EXPECT_FALSE(meter.measure(110)) << "it warms up";
  EXPECT_FALSE(meter.measure(111.5)) << "no update has come since";
  learned(2);
  EXPECT_FALSE(meter.measure(112)) << "the window opens";
  learned(5);
  for (const double lag : {2.0, 4.0, std::nan("")}) {
    report(lag);
    ASSERT_TRUE(meter.take_report());
  }
  EXPECT_FALSE(meter.take_report()) << "it was read before";
  EXPECT_FALSE(meter.measure(113.9));
  EXPECT_FALSE(meter.measure(114.5)) << "an update is under way";
  learned(6);
  EXPECT_TRUE(meter.measure(114.6));
  EXPECT_NEAR(meter.window().seconds, 2.6, 1e-9);
  EXPECT_EQ(meter.window().decisions, 256u);
  EXPECT_EQ(meter.window().updates, 4u);
  EXPECT_THAT(meter.window().windows, ElementsAre(DoubleNear(192 / 1.9, 1e-6), DoubleNear(64 / 0.7, 1e-6)))
      << "from update to update as well";
  EXPECT_DOUBLE_EQ(meter.lag_mean(), 3.0) << "of the window alone";
  learned(7);
  EXPECT_FALSE(meter.measure(120)) << "it is over once";
}

TEST_F(RateMeterTest, AWindowWithoutAnUpdateClosesInTheEnd) {
  plan_.seconds = 2;
  RateMeter meter(plan_);
  meter.use(&arena_);
  learner_says(0, 0, 1);
  (void)meter.count();
  learner_says(64, 1, 1);
  (void)meter.count();
  EXPECT_FALSE(meter.measure(100));
  EXPECT_FALSE(meter.measure(119.9));
  EXPECT_TRUE(meter.measure(120.1));
  EXPECT_EQ(meter.window().decisions, 0u);
  EXPECT_THAT(meter.window().windows, ElementsAre(0.0));
}

TEST_F(RateMeterTest, WithoutALearnerWhatSimulatorsPlayCounts) {
  plan_.policy = PolicySource::kRandom;
  RateMeter meter(plan_);
  meter.use(&arena_);
  arena_.sim_counters(0).decisions = 30;
  arena_.sim_counters(1).decisions = 12;
  EXPECT_FALSE(meter.count());
  EXPECT_EQ(meter.decisions(), 42u);
  arena_.sim_counters(1).decisions = 0;  // it began anew
  (void)meter.count();
  arena_.sim_counters(1).decisions = 5;
  (void)meter.count();
  EXPECT_EQ(meter.decisions(), 47u);
}

TEST_F(RateMeterTest, AnEpisodePlayedTwiceCountsOnce) {
  RateMeter meter(plan_);
  const auto add = [&](uint64_t id, float score) {
    EpisodeRecord episode;
    episode.episode_id = id;
    episode.score = score;
    meter.add(episode);
  };
  add(3, 10);
  add(1, 20);
  add(3, 70);
  EXPECT_EQ(meter.episodes().size(), 2u);
  EXPECT_DOUBLE_EQ(meter.episode_score_mean(), 15);
}

TEST_F(RateMeterTest, AccountsNameEveryDecisionOfADeadLearner) {
  RateMeter meter(plan_);
  meter.use(&arena_);
  shm::EnvAccount& account = arena_.accounts().of(3);  // two agents: two decisions a step
  account.made = 500, account.sealed = 480, account.taken = 400;
  learner_says(0, 0, 1);
  (void)meter.count();
  arena_.learner_counters().decisions = 600;
  EXPECT_EQ(meter.accounts().waiting, 1000u) << "not looked at yet";
  EXPECT_EQ(meter.learner_ended(), 200u) << "taken and not trained on";
  EXPECT_EQ(meter.learner_ended(), 0u);

  // Its successor goes back to 450 and has trained on 50 before the next look.
  learner_says(450, 9, 2);
  arena_.learner_counters().decisions = 500;
  account.taken = 425;
  EXPECT_TRUE(meter.count());
  DecisionAccounts now = meter.accounts();
  EXPECT_EQ(now.made, 1000u);
  EXPECT_EQ(now.trained, 650u);
  EXPECT_EQ(now.forgotten, 150u);
  EXPECT_EQ(now.lost_with_learners, 200u);
  EXPECT_EQ(now.waiting, 150u);
  EXPECT_EQ(now.made, now.trained + now.lost() + now.waiting);
  EXPECT_THAT(now.text(),
              HasSubstr("of 1000 decisions made 650 were trained on (150 of them forgotten), 200 lost "
                        "with the learner, 150 wait"));

  (void)arena_.reclaim_sim_worker(3 / arena_.shape().envs_per_worker);
  meter.close();
  now = meter.accounts();
  EXPECT_EQ(now.lost_with_simulators, 40u);
  EXPECT_EQ(now.left, 110u);
  EXPECT_EQ(now.waiting, 0u);
  EXPECT_EQ(now.made, now.trained + now.lost());
  EXPECT_EQ(meter.account_fault(), "");
}

TEST_F(RateMeterTest, AnArenaThatIsGivenUpLosesWhatLayInItAndALearnerThatCountsTooMuchIsSeen) {
  RateMeter meter(plan_);
  meter.use(&arena_);
  arena_.accounts().of(0).made = arena_.accounts().of(0).sealed = 50;
  learner_says(0, 0, 1);
  arena_.learner_counters().decisions = 30;
  (void)meter.count();
  const shm::Arena next = *shm::Arena::create(test::small_arena_shape(), 2);
  meter.use(&next);
  EXPECT_EQ(meter.accounts().lost_in_restarts, 70u);
  EXPECT_EQ(meter.accounts().made, 100u);

  next.learner_counters().epoch = 1;
  next.learner_counters().decisions = 8;
  next.learner_counters().state = shm::WorkerState::kRunning;
  EXPECT_EQ(meter.learner_ended(), 0u);
  EXPECT_THAT(meter.account_fault(), HasSubstr("do not add up"));
}

}  // namespace rate_meter_test
}  // namespace comrad::deploy
