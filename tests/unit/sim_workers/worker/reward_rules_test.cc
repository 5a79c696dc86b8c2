#include "sim_workers/worker/reward_rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace comrad::sim {
namespace reward_rules_test {

using ::testing::ElementsAre;

std::vector<float> shaped(std::vector<float> raw, const RewardRules& rules) {
  shape_rewards(raw, rules, raw);
  return raw;
}

TEST(ShapeRewards, SharingHasItsKnownAnswers) {
  EXPECT_THAT(shaped({2, 6}, {.share = 0.25f, .share_is_mean = true}), ElementsAre(2.5f, 5.5f));
  EXPECT_THAT(shaped({1, 3}, {.share = 0.5f}), ElementsAre(2.5f, 3.5f));
  EXPECT_THAT(shaped({1, 3}, {.share = 1.0f}), ElementsAre(4.0f, 4.0f));
  EXPECT_THAT(shaped({1, 3}, {}), ElementsAre(1.0f, 3.0f));
}

TEST(ShapeRewards, ClipsAfterScaleAndScalesAfterSharing) {
  EXPECT_THAT(shaped({3, -4, 0}, {.scale = 2.0f, .clip = 5.0f}), ElementsAre(5.0f, -5.0f, 0.0f));
  EXPECT_THAT(shaped({3, -3}, {.share = 1.0f, .scale = 100.0f, .clip = 5.0f}), ElementsAre(0.0f, 0.0f));
}

TEST(ShapeRewards, OneAgentsTeamIsItself) {
  EXPECT_THAT(shaped({7}, {.share = 0.5f}), ElementsAre(7.0f));
  EXPECT_THAT(shaped({7}, {.share = 0.5f, .share_is_mean = true}), ElementsAre(7.0f));
}

TEST(RewardRules, ComeFromTheSettings) {
  RunConfig config;
  config.environment.shared_reward_alpha = 0.5;
  config.environment.shared_reward_scalarisation = Scalarisation::kMean;
  config.environment.reward_scale = 3;
  config.environment.reward_clip = 9;
  const RewardRules rules = RewardRules::from(config);
  EXPECT_EQ(rules.share, 0.5f);
  EXPECT_TRUE(rules.share_is_mean);
  EXPECT_EQ(rules.scale, 3.0f);
  EXPECT_EQ(rules.clip, 9.0f);
}

}  // namespace reward_rules_test
}  // namespace comrad::sim
