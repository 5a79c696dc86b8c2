#include "learner/algorithms/lr_schedule.h"

#include <gtest/gtest.h>

namespace comrad::learn {
namespace {

RunConfig config_with(const char* schedule) {
  RunConfig config;
  config.lr_schedule = schedule;
  config.train_for_env_steps = 1000;
  return config;
}

TEST(LrSchedule, ConstantStaysConstant) {
  LrSchedule schedule(config_with("constant"));
  schedule.before_batch(999);
  schedule.after_minibatch(1.0);
  schedule.after_epoch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
}

TEST(LrSchedule, LinearDecayReachesZeroAtTheLastEnvFrame) {
  LrSchedule schedule(config_with("linear_decay"));
  schedule.before_batch(0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
  schedule.before_batch(500);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 0.5e-4);
  schedule.before_batch(1000);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 0);
  schedule.before_batch(2000);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 0);
}

TEST(LrSchedule, KlAdaptiveMovesByAFactorOutsideTheBand) {
  LrSchedule schedule(config_with("kl_adaptive_minibatch"));
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
  LrSchedule schedule(config_with("kl_adaptive_epoch"));
  schedule.after_minibatch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4);
  schedule.after_epoch(1.0);
  EXPECT_DOUBLE_EQ(schedule.learning_rate(), 1e-4 / 1.5);
}

}  // namespace
}  // namespace comrad::learn
