#include "rollout_buffer/settings/schedule.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/reward_weights.h"
#include "rollout_buffer/settings/setting.h"
#include "tests/support/scratch_folder.h"

namespace comrad {
namespace schedule_test {

using ::testing::AllOf;
using ::testing::HasSubstr;

Schedule parsed(const std::string& text) {
  const Expected<Schedule> schedule = Schedule::parse(text);
  EXPECT_TRUE(schedule) << text;
  return schedule ? *schedule : Schedule(-1);
}

TEST(Schedule, ANumberHoldsAllTheTime) {
  for (const Schedule& schedule : {Schedule(4e-4), parsed("4e-4"), parsed(" +0.0004 "), parsed("4e-4@3e6")}) {
    EXPECT_TRUE(schedule.is_constant());
    EXPECT_EQ(schedule, 4e-4);
    EXPECT_EQ(schedule.at(0), 4e-4);
    EXPECT_EQ(schedule.at(1e12), 4e-4);
    EXPECT_EQ(schedule.text(), "4e-04");
  }
}

TEST(Schedule, StepsHoldUntilTheNextPoint) {
  const Schedule schedule = parsed("0@0,3@2.4e6, -1@5e6");
  EXPECT_EQ(schedule.at(0), 0);
  EXPECT_EQ(schedule.at(2'399'999), 0);
  EXPECT_EQ(schedule.at(2'400'000), 3);
  EXPECT_EQ(schedule.at(4'999'999), 3);
  EXPECT_EQ(schedule.at(5'000'000), -1);
  EXPECT_EQ(schedule.at(1e15), -1);
  EXPECT_EQ(schedule.last(), -1);
}

TEST(Schedule, LinesAreStraightAndMixWithSteps) {
  const Schedule schedule = parsed("1@1000..0@2000,0.5@3000..0.25@4000");
  EXPECT_EQ(schedule.at(0), 1) << "the first value holds before its point";
  EXPECT_EQ(schedule.at(1000), 1);
  EXPECT_DOUBLE_EQ(schedule.at(1250), 0.75);
  EXPECT_EQ(schedule.at(2000), 0);
  EXPECT_EQ(schedule.at(2999), 0);
  EXPECT_EQ(schedule.at(3000), 0.5);
  EXPECT_DOUBLE_EQ(schedule.at(3500), 0.375);
  EXPECT_EQ(schedule.at(9000), 0.25);
  // Against the definition, everywhere.
  const Schedule epsilon = Schedule::line(1, 0.01, 2e7);
  for (const double frames : {0.0, 5e6, 1e7, 2e7, 9e7})
    EXPECT_NEAR(epsilon.at(frames), 1 - 0.99 * std::min(frames / 2e7, 1.0), 1e-12) << frames;
}

TEST(Schedule, WholeNumbersOnALineAreTheNearest) {
  const Schedule schedule = parsed("10@0..3@7000");
  for (int frames = 0; frames <= 8000; frames += 250)
    EXPECT_EQ(schedule.rounded_at(frames), frames >= 7000 ? 3 : std::lround(10 - frames / 1000.0)) << frames;
  EXPECT_EQ(parsed("5").rounded_at(1e9), 5);
}

TEST(Schedule, ItsTextReadsBackWithoutLoss) {
  for (const char* text : {"0.1", "-3", "0@0,3@2.4e6", "1@0..0.05@3e5",
                           "1@10..0@20,0.5@30..0.123456789012345@40", "0.30000000000000004@0..1e-300@1e15"}) {
    const Schedule schedule = parsed(text);
    EXPECT_EQ(parsed(schedule.text()), schedule) << text << " became " << schedule.text();
  }
  EXPECT_EQ(parsed("1e-2@0 .. 0.003@2000000").text(), "0.01@0..0.003@2e6");
}

TEST(Schedule, WhatIsNoneIsRefusedWithWhatIsAllowed) {
  std::string many = "0@0";
  for (int point = 1; point <= 64; ++point) many += "," + std::to_string(point) + "@" + std::to_string(point);
  for (const std::string& text :
       {std::string(""),           std::string("x"),          std::string("nan"),
        std::string("1e999"),      std::string("1@"),         std::string("@1"),
        std::string("1,2"),        std::string("1@0,2"),      std::string("1..2@5"),
        std::string("1@5,2@5"),    std::string("1@5,2@4"),    std::string("1@-1,2@4"),
        std::string("1@0,2@1e16"), std::string("1@0,"),       std::string("1@0.."),
        std::string(",1@0"),       std::string("1@0....2@4"), std::string("1@0@2"),
        std::string("1@0,nan@4"),  std::string("1@0,2@inf"),  many}) {
    const Expected<Schedule> schedule = Schedule::parse(text);
    ASSERT_FALSE(schedule) << text << " was taken as " << schedule->text();
    EXPECT_THAT(schedule.error().message, AllOf(HasSubstr("'" + text + "'"),
                                                HasSubstr("1e-3@0,1e-4@2e6 (steps)"), HasSubstr("(a line)")));
  }
}

TEST(ScheduleSettings, TakeANumberOrASchedule) {
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, {"command line",
                                   {{"learning_rate", "4e-4@0..1e-4@8e6"},
                                    {"ppo_clip_ratio", "0.2"},
                                    {"exploration_loss_coeff", "0.01@0,0.003@2e6"}}}));
  EXPECT_DOUBLE_EQ(config.optimisation.learning_rate.at(4e6), 2.5e-4);
  EXPECT_EQ(config.on_policy.ppo_clip_ratio, 0.2);
  EXPECT_EQ(config.on_policy.exploration_loss_coeff.at(2e6), 0.003);
  const Status wrong = apply_layer(config, {"command line", {{"learning_rate", "fast"}}});
  ASSERT_FALSE(wrong);
  EXPECT_THAT(wrong.error().message,
              AllOf(HasSubstr("learning_rate is 'fast'"), HasSubstr("a number, or numbers")));
}

TEST(ScheduleSettings, EveryPointLiesWithinTheLimits) {
  RunConfig config;
  config.environment.num_agents = 2;
  config.optimisation.learning_rate = parsed("4e-4@0..2@8e6");
  const Status far = resolve_settings(config, 2);
  ASSERT_FALSE(far);
  EXPECT_THAT(far.error().message, AllOf(HasSubstr("learning_rate is 4e-4@0..2@8e6"), HasSubstr("0 and 1")));
}

TEST(ScheduleSettings, OnlyOneThingMovesTheLearningRate) {
  RunConfig config;
  config.environment.num_agents = 2;
  config.optimisation.learning_rate = parsed("4e-4@0..1e-4@8e6");
  ASSERT_TRUE(resolve_settings(config, 2));
  config.optimisation.lr_schedule = RateSchedule::kLinearDecay;
  const Status both = resolve_settings(config, 2);
  ASSERT_FALSE(both);
  EXPECT_THAT(both.error().message,
              AllOf(HasSubstr("lr_schedule linear_decay"), HasSubstr("must be constant")));
}

TEST(ScheduleSettings, GoThroughTomlWithoutLoss) {
  const test::ScratchFolder scratch;
  RunConfig config;
  config.optimisation.learning_rate = parsed("4e-4@0..1e-4@8e6");
  config.environment.reward = "hare_kill=0@0,3@2.4e6,own_death=-1";
  const Expected<RunConfig> read = load_run_config(scratch.write("config.toml", settings_to_toml(config)));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->optimisation.learning_rate, config.optimisation.learning_rate);
  EXPECT_EQ(read->on_policy.ppo_clip_ratio, config.on_policy.ppo_clip_ratio);
  EXPECT_EQ(read->q_learning.epsilon, config.q_learning.epsilon);
  EXPECT_EQ(read->environment.reward, config.environment.reward);
  // By hand: a number stays a number, and points may be a list.
  const auto layer = read_settings_toml(
      scratch.write("mine.toml", "learning_rate = 0.001\nepsilon = [\"1@0\", \"0.1@5e5\"]\n"));
  ASSERT_TRUE(layer) << layer.error().message;
  ASSERT_TRUE(apply_layer(config, *layer));
  EXPECT_EQ(config.optimisation.learning_rate, 0.001);
  EXPECT_EQ(config.q_learning.epsilon, parsed("1@0,0.1@5e5"));
}

TEST(ScheduleSettings, EpsilonsOldSettingsAreItsParts) {
  RunConfig config;
  ASSERT_TRUE(apply_layer(
      config, {"config.toml",
               {{"epsilon_start", "0.9"}, {"epsilon_end", "0.05"}, {"epsilon_decay_env_frames", "3e5"}}}));
  EXPECT_EQ(config.q_learning.epsilon, Schedule::line(0.9, 0.05, 3e5));
  ASSERT_TRUE(apply_layer(config, {"command line", {{"epsilon_decay_steps", "4e5"}}}));
  EXPECT_EQ(config.q_learning.epsilon, Schedule::line(0.9, 0.05, 4e5));
  config.q_learning.epsilon = 0.2;
  ASSERT_TRUE(apply_layer(config, {"command line", {{"epsilon_end", "0.1"}}}));
  EXPECT_EQ(config.q_learning.epsilon.at(1e6), 0.1);
  for (const auto& [name, text] : {std::pair("epsilon_start", "2"),
                                   {"epsilon_end", "x"},
                                   {"epsilon_decay_env_frames", "0"},
                                   {"epsilon_decay_steps", "1e16"}}) {
    const Status wrong = apply_layer(config, {"command line", {{name, text}}});
    ASSERT_FALSE(wrong) << name;
    EXPECT_THAT(wrong.error().message, AllOf(HasSubstr(text), HasSubstr("--epsilon 1@0..0.01@2e7")));
  }
}

TEST(RewardWeights, AreReadInTheirOrderEachWithItsSchedule) {
  const auto weights = parse_reward_weights(" hare_kill=0@0, 3@2.4e6 ,own_death=-1,stag=0.5@0..1@1e6");
  ASSERT_TRUE(weights) << weights.error().message;
  ASSERT_EQ(weights->size(), 3u);
  EXPECT_EQ((*weights)[0].name, "hare_kill");
  EXPECT_EQ((*weights)[0].weight, parsed("0@0,3@2.4e6"));
  EXPECT_EQ((*weights)[1].name, "own_death");
  EXPECT_EQ((*weights)[1].weight, -1);
  EXPECT_DOUBLE_EQ((*weights)[2].weight.at(5e5), 0.75);
  EXPECT_TRUE(has_reward_schedule("hare_kill=0@0,3@2.4e6"));
  EXPECT_FALSE(has_reward_schedule("hare_kill=3,own_death=-1"));
  EXPECT_FALSE(has_reward_schedule(""));
}

TEST(RewardWeights, WhatIsNoneIsRefused) {
  std::string many;
  for (int term = 0; term < 65; ++term) many += "t" + std::to_string(term) + "=1,";
  for (const std::string& text :
       {std::string("3@2e6"), std::string("a"), std::string("=3"), std::string("a="), std::string("a=1,2"),
        std::string("a=1@5,2@4"), std::string("a=2e6"), std::string("a=1@0..2e6@9"), many}) {
    const auto weights = parse_reward_weights(text);
    ASSERT_FALSE(weights) << text;
    EXPECT_THAT(weights.error().message,
                AllOf(HasSubstr("'" + text + "'"), HasSubstr("NAME=0@0,3@2e6 (steps)")));
  }
}

}  // namespace schedule_test
}  // namespace comrad
