#include "scenarios/spec/rewards.h"

#include <gtest/gtest.h>

namespace comrad::scenarios {
namespace rewards_test {

RewardTerm term(const std::string& kind, double weight, double cap = 0.0) {
  RewardTerm result;
  result.kind = kind;
  result.weight = weight;
  result.cap = cap;
  return result;
}

/// The rewards that one agent gets for a variable that starts at the first value and takes the others one
/// by one.
std::vector<double> rewards_of(const RewardTerm& reward_term, const std::vector<double>& values) {
  RewardTracker tracker({reward_term}, 1);
  tracker.reset(std::span(values).first(1));
  std::vector<double> result;
  for (std::size_t i = 1; i < values.size(); ++i) {
    double reward = -99;
    tracker.step(std::span(values).subspan(i, 1), std::span(&reward, 1));
    result.push_back(reward);
  }
  return result;
}

using Doubles = std::vector<double>;

TEST(Rewards, DeltaPaysEveryChange) {
  EXPECT_EQ(rewards_of(term("delta", 0.5), {100, 104, 98, 98}), (Doubles{2, -3, 0}));
}

TEST(Rewards, RisePaysGainsOnly) {
  EXPECT_EQ(rewards_of(term("rise", 0.5), {100, 104, 98, 98}), (Doubles{2, 0, 0}));
}

TEST(Rewards, FallPaysTheSizeOfALoss) {
  EXPECT_EQ(rewards_of(term("fall", -0.5), {100, 104, 98, 98}), (Doubles{0, -3, 0}));
}

TEST(Rewards, NewMaxPaysOnlyBeyondTheBestSoFar) {
  EXPECT_EQ(rewards_of(term("new_max", 1), {2, 5, 3, 4, 7}), (Doubles{3, 0, 0, 2}));
}

TEST(Rewards, ValuePaysEveryDecision) {
  EXPECT_EQ(rewards_of(term("value", 2), {1, 3, 3, 0}), (Doubles{6, 6, 0}));
}

TEST(Rewards, EventPaysOnceForAnyRise) {
  EXPECT_EQ(rewards_of(term("event", -3), {0, 1, 1, 0, 5}), (Doubles{-3, 0, 0, -3}));
}

TEST(Rewards, TheFirstDecisionStartsFromTheTrueStart) {
  for (const std::string& kind : reward_kinds()) {
    if (kind == "value") continue;
    EXPECT_EQ(rewards_of(term(kind, 0.1), {100, 100}), (Doubles{0})) << kind;
  }
}

TEST(Rewards, TheCapClipsTheAmountBeforeTheWeight) {
  EXPECT_EQ(rewards_of(term("delta", 2, 3), {0, 10, 0, 1}), (Doubles{6, -6, 2}));
}

TEST(Rewards, AnEpisodeRemembersNothingOfTheOneBefore) {
  RewardTracker tracker({term("new_max", 1)}, 1);
  const double high = 50, start = 0, now = 4;
  double reward = 0;
  tracker.reset(std::span(&start, 1));
  tracker.step(std::span(&high, 1), std::span(&reward, 1));
  EXPECT_EQ(reward, 50);
  tracker.reset(std::span(&start, 1));
  tracker.step(std::span(&now, 1), std::span(&reward, 1));
  EXPECT_EQ(reward, 4);
}

TEST(Rewards, TermsAddUpPerAgentAndPerAgentWeightsAreShared) {
  RewardTerm shared = term("rise", 0.5);
  shared.scope = "team";
  shared.per_agent = true;
  RewardTracker tracker({term("rise", 0.1), shared}, 2);
  const std::vector<double> start = {100, 100, 0, 0}, now = {110, 90, 3, 3};
  std::vector<double> reward(2);
  tracker.reset(start);
  tracker.step(now, reward);
  EXPECT_DOUBLE_EQ(reward[0], 1.0 + 0.75);
  EXPECT_DOUBLE_EQ(reward[1], 0.75);
  EXPECT_EQ(std::vector<double>(tracker.parts().begin(), tracker.parts().end()),
            (Doubles{1.0, 0, 0.75, 0.75}))
      << "[term, agent]";
}

TEST(Rewards, WeightsCanBeChangedAndTheCeilingOfAReturnIsUnknownThen) {
  ScenarioSpec spec;
  spec.name = "toy";
  spec.score = "survival_tics";
  spec.ceiling = 10;
  spec.rewards.resize(2);
  spec.rewards[0].name = "kit", spec.rewards[0].weight = 1;
  spec.rewards[1].name = "death", spec.rewards[1].weight = -1;
  ASSERT_TRUE(change_weights(spec, {{"death", -3}}));
  EXPECT_EQ(spec.rewards[0].weight, 1);
  EXPECT_EQ(spec.rewards[1].weight, -3);
  EXPECT_EQ(spec.ceiling, 10) << "survival does not depend on rewards";
  const Status unknown = change_weights(spec, {{"deth", 1}});
  ASSERT_FALSE(unknown);
  EXPECT_NE(unknown.error().message.find("did you mean 'death'"), std::string::npos);
  spec.score = "return";
  ASSERT_TRUE(change_weights(spec, {}));
  EXPECT_EQ(spec.ceiling, 10);
  ASSERT_TRUE(change_weights(spec, {{"kit", 2}}));
  EXPECT_EQ(spec.ceiling, 0);
  EXPECT_FALSE(spec.maps_say_ceiling);
}

TEST(Rewards, WeightsFollowTheRunsEnvFrames) {
  std::vector<RewardTerm> terms = {term("delta", 1.0), term("rise", 1.0)};
  terms[0].weight = *Schedule::parse("0@0,3@2.4e6");
  terms[1].weight = *Schedule::parse("1@0..2@1e6");
  terms[1].per_agent = true;
  RewardTracker tracker(terms, 2);
  std::vector<double> reward(2);
  const auto paid = [&](double env_frames) {
    tracker.set_env_frames(env_frames);
    tracker.reset(Doubles{0, 0, 0, 0});
    tracker.step(Doubles{1, 10, 1, 1}, reward);
    return reward;
  };
  EXPECT_EQ(paid(0), (Doubles{0.5, 0.5}));
  EXPECT_EQ(paid(5e5), (Doubles{0.75, 0.75}));
  EXPECT_EQ(paid(2'399'999), (Doubles{1, 1}));
  EXPECT_EQ(paid(2.4e6), (Doubles{4, 31}));
}

TEST(Rewards, WithoutTermsTheRewardIsZero) {
  RewardTracker tracker({}, 2);
  std::vector<double> reward = {5, 5};
  tracker.reset({});
  tracker.step({}, reward);
  EXPECT_EQ(reward, (Doubles{0, 0}));
}

TEST(Rewards, AShutTermPaysNothingAndForgetsNothing) {
  RewardTerm gated = term("rise", 1.0);
  gated.when = "TRUNCATED";
  RewardTracker tracker({gated}, 2);
  tracker.reset(std::vector<double>{0.0, 0.0});
  std::vector<double> reward(2);
  tracker.step(std::vector<double>{5.0, 5.0}, reward, std::vector<uint8_t>{0, 1});
  EXPECT_EQ(reward, (std::vector<double>{0.0, 5.0}));
  tracker.step(std::vector<double>{7.0, 7.0}, reward, std::vector<uint8_t>{1, 1});
  EXPECT_EQ(reward, (std::vector<double>{2.0, 2.0}));
}

}  // namespace rewards_test
}  // namespace comrad::scenarios
