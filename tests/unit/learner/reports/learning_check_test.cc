#include "learner/reports/learning_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace comrad::learn {
namespace learning_check_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

RunConfig config_of(const std::string& algo) {
  RunConfig config;
  config.run.algo = algo;
  config.environment.num_agents = 2;
  return config;
}

/// What `reports` reports of the same numbers make of it.
std::vector<std::string> told(const RunConfig& config, const MetricValues& values, int reports = 12) {
  LearningCheck check(config);
  std::vector<std::string> all;
  for (int report = 0; report < reports; ++report)
    for (const std::string& warning : check.judge(values)) all.push_back(warning);
  return all;
}

TEST(LearningCheck, ClippedSamplesBeforeTheFirstStep) {
  const RunConfig config = config_of("ippo");
  EXPECT_THAT(told(config, {{"train/fraction_clipped_first", 0.3}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/fraction_clipped_first", 0.31}}),
              ElementsAre(AllOf(HasSubstr("31% of the samples"), HasSubstr("ppo_clip_ratio (0.1)"))));
}

TEST(LearningCheck, TheLastEpochsShareCountsOnlyWhereItIsTheFirst) {
  RunConfig config = config_of("ippo");
  EXPECT_THAT(told(config, {{"train/fraction_clipped", 0.4}}), SizeIs(1));
  EXPECT_THAT(told(config, {{"train/fraction_clipped", 0.4}, {"train/fraction_clipped_first", 0.1}}),
              IsEmpty());
  config.optimisation.num_epochs = 4;
  EXPECT_THAT(told(config, {{"train/fraction_clipped", 0.4}}), IsEmpty());
}

TEST(LearningCheck, AnEpsilonThatSwallowsAPartsGradient) {
  const RunConfig config = config_of("qmix");
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.1}, {"train/adam_gain_mixer", 0.9}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.09}, {"train/adam_gain_mixer", 0.9}}),
              ElementsAre(AllOf(HasSubstr("\"core\""), HasSubstr("0.09"), HasSubstr("adam_eps (1e-06)"))));
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.09}, {"train/adam_gain_mixer", 0.01}}), SizeIs(2));
  // Moments that have not filled yet, and gradients that nothing was paid for, show nothing.
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.01}, {"train/num_sgd_steps", 999}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.01}, {"train/num_sgd_steps", 1000}}), SizeIs(1));
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.01}, {"stats/rewarded_episodes_fraction", 0}}),
              IsEmpty());
  EXPECT_THAT(told(config, {{"train/adam_gain_core", 0.01}, {"stats/rewarded_episodes_fraction", 0.01}}),
              SizeIs(1));
}

TEST(LearningCheck, TargetsBeyondTheLimit) {
  EXPECT_THAT(told(config_of("vdn"), {{"train/targets_clipped_fraction", 0.1}}), IsEmpty());
  EXPECT_THAT(told(config_of("vdn"), {{"train/targets_clipped_fraction", 0.11}}),
              ElementsAre(AllOf(HasSubstr("11% of the value targets"), HasSubstr("q_value_clamp (100)"))));
  EXPECT_THAT(told(config_of("mappo"), {{"train/targets_clipped_fraction", 0.11}}),
              ElementsAre(HasSubstr("returns_clip (5)")));
}

TEST(LearningCheck, AMixersStateThatGrows) {
  EXPECT_THAT(told(config_of("qmix"), {{"train/mixer_state_rms", 2.9}}), IsEmpty());
  EXPECT_THAT(told(config_of("qmix"), {{"train/mixer_state_rms", 4.41}}),
              ElementsAre(AllOf(HasSubstr("root mean square of 4.4"), HasSubstr("mixer_state_deviation"),
                                HasSubstr("max_grad_norm (4)"))));
}

TEST(LearningCheck, EpisodesWithoutAnyReward) {
  RunConfig config = config_of("ippo");
  const auto values = [](double fraction, double episodes) {
    return MetricValues{{"stats/rewarded_episodes_fraction", fraction}, {"stats/episodes", episodes}};
  };
  EXPECT_THAT(told(config, values(0, 99)), IsEmpty());
  EXPECT_THAT(told(config, values(0.01, 100)), IsEmpty());
  EXPECT_THAT(told(config, values(0, 100)), ElementsAre(HasSubstr("none of the last 100 episodes")));
  config.run.stats_avg = 300;
  EXPECT_THAT(told(config, values(0, 299)), IsEmpty());
  EXPECT_THAT(told(config, values(0, 300)), ElementsAre(HasSubstr("none of the last 300 episodes")));
}

TEST(LearningCheck, ACriticWorseThanTheMean) {
  const RunConfig config = config_of("happo");
  EXPECT_THAT(told(config, {{"train/explained_variance", 0}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/explained_variance", -0.01}}, 11), IsEmpty());
  EXPECT_THAT(told(config, {{"train/explained_variance", -0.01}}), ElementsAre(HasSubstr("variance -0.01")));
  EXPECT_THAT(told(config, {{"train/explained_variance", -0.01}, {"train/num_sgd_steps", 999}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/explained_variance", -0.01}, {"stats/rewarded_episodes_fraction", 0}}),
              IsEmpty());
}

TEST(LearningCheck, BatchesThatAreMostlyMasked) {
  EXPECT_THAT(told(config_of("ippo"), {{"train/valids_fraction", 0.5}}), IsEmpty());
  EXPECT_THAT(told(config_of("ippo"), {{"train/valids_fraction", 0.49}}),
              ElementsAre(AllOf(HasSubstr("only 49%"), HasSubstr("max_policy_lag (1000"))));
}

TEST(LearningCheck, DecisionsOfAnOldPolicy) {
  RunConfig config = config_of("ippo");
  config.optimisation.num_epochs = 2;
  EXPECT_THAT(told(config, {{"train/version_diff_avg", 20}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/version_diff_avg", 21}}),
              ElementsAre(HasSubstr("21 optimizer steps (10 batches) old")));
  config.run.algo = "happo";  // three versions a batch of two agents
  EXPECT_THAT(told(config, {{"train/version_diff_avg", 60}}), IsEmpty());
  EXPECT_THAT(told(config, {{"train/version_diff_avg", 61}}), SizeIs(1));
  config.run.algo = "qmix";  // a replay is old on purpose
  EXPECT_THAT(told(config, {{"train/version_diff_avg", 1e5}}), IsEmpty());
}

TEST(LearningCheck, ExplorationThatDoesNotEndWithTheRun) {
  RunConfig config = config_of("vdn");
  config.run.train_for_env_frames = 2e6;  // of 2e7 that epsilon falls over
  EXPECT_THAT(LearningCheck(config).judge_settings(),
              ElementsAre(AllOf(HasSubstr("epsilon 0.90"), HasSubstr("--epsilon (1@0..0.01@2e7)"))));
  config.run.train_for_env_frames = 2e7 * (0.5 / 0.99) + 1;  // where epsilon is 0.5
  EXPECT_THAT(LearningCheck(config).judge_settings(), IsEmpty());
  config.run.train_for_env_frames -= 1e4;
  EXPECT_THAT(LearningCheck(config).judge_settings(), SizeIs(1));
  config.q_learning.epsilon = 1;  // uniform play was requested
  EXPECT_THAT(LearningCheck(config).judge_settings(), IsEmpty());
  EXPECT_THAT(LearningCheck(config_of("ippo")).judge_settings(), IsEmpty());
}

TEST(LearningCheck, ReportsAFindingOnceAfterItStoodSixReportsInARow) {
  const MetricValues bad = {{"train/valids_fraction", 0.1}}, good = {{"train/valids_fraction", 1.0}};
  LearningCheck check(config_of("ippo"));
  for (int report = 0; report < 5; ++report) EXPECT_THAT(check.judge(bad), IsEmpty());
  EXPECT_THAT(check.judge(good), IsEmpty());
  for (int report = 0; report < 5; ++report) EXPECT_THAT(check.judge(bad), IsEmpty());
  // What is missing or no number is not judged; it neither counts nor interrupts.
  EXPECT_THAT(check.judge({}), IsEmpty());
  EXPECT_THAT(check.judge({{"train/valids_fraction", std::nan("")}}), IsEmpty());
  EXPECT_THAT(check.judge(bad), SizeIs(1));
  for (int report = 0; report < 20; ++report) EXPECT_THAT(check.judge(bad), IsEmpty());
}

TEST(LearningCheck, AHealthyReportPrintsNothing) {
  const MetricValues values = {{"train/fraction_clipped_first", 0.05},  {"train/adam_gain_encoder", 0.95},
                               {"train/targets_clipped_fraction", 0},   {"train/mixer_state_rms", 1},
                               {"train/explained_variance", 0.4},       {"train/valids_fraction", 1},
                               {"train/version_diff_avg", 2},           {"train/num_sgd_steps", 5000},
                               {"stats/rewarded_episodes_fraction", 1}, {"stats/episodes", 1000}};
  for (const char* algo : {"ippo", "mappo", "happo", "idqn", "qmix"})
    EXPECT_THAT(told(config_of(algo), values), IsEmpty()) << algo;
}

}  // namespace learning_check_test
}  // namespace comrad::learn
