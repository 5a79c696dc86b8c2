#include "learner/schedules/lr_schedule.h"

#include <gtest/gtest.h>

namespace comrad::learn {
namespace lr_schedule_test {

RunConfig config_with(RateSchedule schedule) {
  RunConfig config;
  config.optimisation.lr_schedule = schedule;
  config.run.train_for_env_frames = 1000;
  return config;
}

TEST(LrSchedule, ConstantStaysConstant) {
  LrSchedule schedule(config_with(RateSchedule::kConstant));
  schedule.before_batch(999);
  schedule.after_minibatch(1.0);
  schedule.after_epoch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
}

TEST(LrSchedule, TheSettingMayBeASeparateSchedule) {
  RunConfig config = config_with(RateSchedule::kConstant);
  config.optimisation.learning_rate = *Schedule::parse("4e-4@0..2e-4@500,1e-5@800");
  LrSchedule schedule(config);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 4e-4);
  schedule.before_batch(250);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 3e-4);
  schedule.before_batch(799);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 2e-4);
  StateDict state;
  schedule.save(state);
  LrSchedule resumed(config);
  ASSERT_TRUE(resumed.load(state));
  for (LrSchedule* one : {&schedule, &resumed}) {
    one->before_batch(800);
    EXPECT_DOUBLE_EQ(one->learning_rate(), 1e-5);
  }
}

TEST(LrSchedule, LinearDecayReachesZeroAtTheLastEnvFrame) {
  LrSchedule schedule(config_with(RateSchedule::kLinearDecay));
  schedule.before_batch(0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
  schedule.before_batch(500);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 0.5e-4);
  schedule.before_batch(1000);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 0);
  schedule.before_batch(2000);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 0);
}

TEST(LrSchedule, AnExtendedRunContinuesFromTheRateItHadToZeroAtItsNewEnd) {
  LrSchedule first(config_with(RateSchedule::kLinearDecay));
  first.before_batch(800);
  StateDict state;
  first.save(state);
  RunConfig longer = config_with(RateSchedule::kLinearDecay);
  longer.run.train_for_env_frames = 2000;
  LrSchedule second(longer);
  ASSERT_TRUE(second.load(state));
  EXPECT_DOUBLE_EQ(second.learning_rate(), 0.2e-4);
  second.before_batch(800);
  EXPECT_DOUBLE_EQ(second.learning_rate(), 0.2e-4);
  second.before_batch(1400);
  EXPECT_DOUBLE_EQ(second.learning_rate(), 0.1e-4);
  StateDict later;
  second.save(later);
  LrSchedule third(longer);  // an ordinary resume stays on that line
  ASSERT_TRUE(third.load(later));
  third.before_batch(1700);
  EXPECT_DOUBLE_EQ(third.learning_rate(), 0.05e-4);
  third.before_batch(2000);
  EXPECT_DOUBLE_EQ(third.learning_rate(), 0);
}

TEST(LrSchedule, OlderCheckpointsAndOtherKindsFollowTheFlags) {
  StateDict state;
  state.put("schedule/learning_rate", 3e-5);  // all that older checkpoints have
  LrSchedule linear(config_with(RateSchedule::kLinearDecay)), constant(config_with(RateSchedule::kConstant)),
      adaptive(config_with(RateSchedule::kKlAdaptiveEpoch));
  for (LrSchedule* schedule : {&linear, &constant, &adaptive}) ASSERT_TRUE(schedule->load(state));
  linear.before_batch(500);
  EXPECT_DOUBLE_EQ(linear.learning_rate(), 0.5e-4);
  EXPECT_DOUBLE_EQ(constant.learning_rate(), 1e-4);
  EXPECT_DOUBLE_EQ(adaptive.learning_rate(), 3e-5);
  EXPECT_FALSE(adaptive.load(StateDict()));
}

TEST(LrSchedule, KlAdaptiveMovesByAFactorOutsideTheBand) {
  LrSchedule schedule(config_with(RateSchedule::kKlAdaptiveMinibatch));
  schedule.after_minibatch(0.008);  // inside the band
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
  schedule.after_minibatch(0.017);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4 / 1.5);
  schedule.after_minibatch(0.003);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4 / 1.5 * 1.5);
  schedule.after_epoch(1.0);  // the other kind's event
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4 / 1.5 * 1.5);
  for (int i = 0; i < 100; ++i) schedule.after_minibatch(0.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-2);
  for (int i = 0; i < 100; ++i) schedule.after_minibatch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-6);
}

TEST(LrSchedule, KlAdaptiveEpochListensToEpochs) {
  LrSchedule schedule(config_with(RateSchedule::kKlAdaptiveEpoch));
  schedule.after_minibatch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
  schedule.after_epoch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4 / 1.5);
}

}  // namespace lr_schedule_test
}  // namespace comrad::learn
