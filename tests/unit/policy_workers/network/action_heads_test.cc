#include "policy_workers/network/action_heads.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {
namespace action_heads_test {

EnvShape shape_of(std::initializer_list<int> heads) {
  EnvShape env;
  env.head_count = static_cast<int32_t>(heads.size());
  std::copy(heads.begin(), heads.end(), env.head_sizes.begin());
  return env;
}

void expect_near(const Tensor& tensor, std::vector<double> expected, double tolerance) {
  const Tensor flat = tensor.detach().to(torch::kFloat64).flatten();
  ASSERT_EQ(flat.numel(), static_cast<int64_t>(expected.size()));
  for (size_t index = 0; index < expected.size(); ++index)
    EXPECT_NEAR(flat[static_cast<int64_t>(index)].item<double>(), expected[index], tolerance)
        << "entry " << index;
}

// Two-head policy, logits (0,1,2) and (0.5,-0.5).
const EnvShape kTwoHeads = shape_of({3, 2});
Tensor two_head_logits() { return torch::tensor({{0.0f, 1.0f, 2.0f, 0.5f, -0.5f}}); }

TEST(ActionHeads, MatchTheKnownAnswersOfTheTwoHeadPolicy) {
  const Tensor log_probs = head_log_probs(two_head_logits(), {}, kTwoHeads);
  expect_near(log_probs.exp(), {0.090031, 0.244728, 0.665241, 0.731059, 0.268941}, 1e-6);
  const Tensor actions = torch::tensor({{2, 0}, {0, 1}}, torch::kInt64);
  expect_near(action_log_prob(log_probs.expand({2, 5}), actions, kTwoHeads), {-0.720868, -3.720868}, 1e-6);
  expect_near(entropy(log_probs, kTwoHeads), {1.414599}, 1e-6);
  expect_near(symmetric_kl_to_uniform(log_probs, {}, kTwoHeads), {0.403134}, 1e-6);
  const EnvShape one_head = shape_of({3});
  const Tensor first = head_log_probs(torch::tensor({{0.0f, 1.0f, 2.0f}}), {}, one_head);
  const Tensor uniform = head_log_probs(torch::zeros({1, 3}), {}, one_head);
  expect_near(kl_divergence(first, uniform, one_head), {0.266217}, 1e-6);
  expect_near(symmetric_kl_to_uniform(first, {}, one_head), {0.287605}, 1e-6);
}

TEST(ActionHeads, MaskedSoftmaxMatchesTheKnownAnswer) {
  const EnvShape env = shape_of({3});
  const Tensor mask = torch::tensor({{1, 1, 0}}, torch::kUInt8);
  const Tensor log_probs = head_log_probs(torch::tensor({{0.0f, 1.0f, 2.0f}}), mask, env);
  expect_near(log_probs.exp(), {0.268941, 0.731059, 0.0}, 1e-6);
  EXPECT_LT(log_probs[0][2].item<float>(), -1e8f);
}

TEST(ActionHeads, MaskedChoicesAddNothingToEntropyAndDivergences) {
  // A head of three with one choice masked is a head of two.
  const EnvShape three = shape_of({3}), two = shape_of({2});
  const Tensor mask = torch::tensor({{1, 0, 1}}, torch::kUInt8);
  const Tensor masked = head_log_probs(torch::tensor({{0.3f, 9.0f, -1.1f}}), mask, three);
  const Tensor other = head_log_probs(torch::tensor({{-0.4f, -3.0f, 0.2f}}), mask, three);
  const Tensor plain = head_log_probs(torch::tensor({{0.3f, -1.1f}}), {}, two);
  const Tensor plain_other = head_log_probs(torch::tensor({{-0.4f, 0.2f}}), {}, two);
  expect_near(entropy(masked, three), {entropy(plain, two).item<double>()}, 1e-6);
  expect_near(kl_divergence(masked, other, three), {kl_divergence(plain, plain_other, two).item<double>()},
              1e-6);
  expect_near(symmetric_kl_to_uniform(masked, mask, three),
              {symmetric_kl_to_uniform(plain, {}, two).item<double>()}, 1e-6);
}

TEST(ActionHeads, GradientsStayFiniteUnderMasks) {
  const Tensor logits = torch::randn({16, 5}).requires_grad_();
  Tensor mask = torch::ones({16, 5}, torch::kUInt8);
  mask.slice(1, 1, 3).zero_();
  mask[3].zero_();  // a dead agent: nothing allowed counts as everything allowed
  const Tensor log_probs = head_log_probs(logits, mask, kTwoHeads);
  const Tensor loss = entropy(log_probs, kTwoHeads).sum() +
                      symmetric_kl_to_uniform(log_probs, mask, kTwoHeads).sum() +
                      kl_divergence(log_probs, log_probs.detach() * 1.0, kTwoHeads).sum();
  loss.backward();
  EXPECT_TRUE(torch::isfinite(loss).item<bool>());
  EXPECT_TRUE(torch::isfinite(logits.grad()).all().item<bool>());
  EXPECT_EQ(logits.grad().slice(1, 1, 3)[0].abs().sum().item<float>(), 0.0f);
  EXPECT_GT(logits.grad()[3].abs().sum().item<float>(), 0.0f);
}

TEST(SampleAction, FrequenciesMatchTheProbabilities) {
  const std::vector<float> logits = {0.0f, 1.0f, 2.0f, 0.5f, -0.5f};
  const double expected[] = {0.090031, 0.244728, 0.665241, 0.731059, 0.268941};
  constexpr int kDraws = 200'000;
  int counts[5] = {}, both = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    int32_t action[2];
    sample_action(logits, {}, kTwoHeads, RngKey(7).split(static_cast<uint64_t>(draw)), false, action);
    ++counts[action[0]];
    ++counts[3 + action[1]];
    both += action[0] == 2 && action[1] == 0;
  }
  for (int choice = 0; choice < 5; ++choice) {
    const double p = expected[choice], sigma = std::sqrt(p * (1 - p) / kDraws);
    EXPECT_NEAR(counts[choice] / double{kDraws}, p, 5 * sigma) << "choice " << choice;
  }
  const double joint = expected[2] * expected[3];  // the heads draw independently
  EXPECT_NEAR(both / double{kDraws}, joint, 5 * std::sqrt(joint * (1 - joint) / kDraws));
}

TEST(SampleAction, NeverDrawsAMaskedChoice) {
  const std::vector<float> logits = {0.0f, 50.0f, 2.0f, 0.5f, -0.5f};
  const std::vector<uint8_t> mask = {1, 0, 1, 0, 1};
  for (int draw = 0; draw < 20'000; ++draw) {
    int32_t action[2];
    const bool greedy = draw % 2 == 0;
    const float log_prob =
        sample_action(logits, mask, kTwoHeads, RngKey(3).split(static_cast<uint64_t>(draw)), greedy, action);
    ASSERT_NE(action[0], 1);
    ASSERT_EQ(action[1], 1);
    ASSERT_TRUE(std::isfinite(log_prob));
  }
}

TEST(SampleAction, GivesTheLogProbabilityThatTrainingComputes) {
  const EnvShape env = shape_of({3, 3, 3, 2, 3});
  const Tensor logits = torch::randn({64, 14}) * 3;
  const Tensor mask = torch::rand({64, 14}).gt(0.4).to(torch::kUInt8);
  Tensor actions = torch::empty({64, 5}, torch::kInt64);
  std::vector<float> sampled;
  for (int64_t row = 0; row < 64; ++row) {
    int32_t action[5];
    sampled.push_back(sample_action({logits.data_ptr<float>() + row * 14, 14},
                                    {mask.data_ptr<uint8_t>() + row * 14, 14}, env,
                                    RngKey(static_cast<uint64_t>(row)), false, action));
    for (int64_t head = 0; head < 5; ++head) actions[row][head] = int64_t{action[head]};
  }
  const Tensor trained = action_log_prob(head_log_probs(logits, mask, env), actions, env);
  for (int64_t row = 0; row < 64; ++row)
    EXPECT_NEAR(trained[row].item<float>(), sampled[static_cast<size_t>(row)], 1e-4f) << "row " << row;
}

TEST(SampleAction, GreedyTakesEveryHeadsArgmax) {
  const std::vector<float> logits = {0.0f, 3.0f, 2.0f, 0.5f, 0.6f};
  int32_t action[2];
  sample_action(logits, {}, kTwoHeads, RngKey(1), true, action);
  EXPECT_EQ(action[0], 1);
  EXPECT_EQ(action[1], 1);
}

TEST(SampleAction, TheSameKeyGivesTheSameActionAndAnotherKeyAnother) {
  const std::vector<float> logits(5, 0.0f);
  int distinct = 0;
  for (uint64_t seed = 0; seed < 100; ++seed) {
    int32_t first[2], again[2], other[2];
    sample_action(logits, {}, kTwoHeads, RngKey(seed), false, first);
    sample_action(logits, {}, kTwoHeads, RngKey(seed), false, again);
    sample_action(logits, {}, kTwoHeads, RngKey(seed).split(uint64_t{1}), false, other);
    EXPECT_EQ(first[0], again[0]);
    EXPECT_EQ(first[1], again[1]);
    distinct += first[0] != other[0] || first[1] != other[1];
  }
  EXPECT_GT(distinct, 50);
}

TEST(ExploreAction, DrawsEveryHeadForItself) {
  const std::vector<float> q = {0.0f, 3.0f, 2.0f, 0.5f, -0.5f};
  constexpr int kDraws = 200'000;
  constexpr float kEpsilon = 0.3f;
  int joint[3][2] = {};
  for (int draw = 0; draw < kDraws; ++draw) {
    int32_t action[2];
    const float log_prob = explore_action(q, {}, kTwoHeads, RngKey(9).split(static_cast<uint64_t>(draw)),
                                          kEpsilon, Exploration::kPerHead, action);
    ++joint[action[0]][action[1]];
    EXPECT_NEAR(log_prob,
                std::log(kEpsilon / 3 + (action[0] == 1 ? 1 - kEpsilon : 0)) +
                    std::log(kEpsilon / 2 + (action[1] == 0 ? 1 - kEpsilon : 0)),
                1e-6);
  }
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 2; ++b) {
      const double p =
          (kEpsilon / 3 + (a == 1 ? 1 - kEpsilon : 0)) * (kEpsilon / 2 + (b == 0 ? 1 - kEpsilon : 0));
      EXPECT_NEAR(joint[a][b] / double{kDraws}, p, 5 * std::sqrt(p * (1 - p) / kDraws)) << a << b;
    }
}

TEST(ExploreAction, OneHeadAloneLeavesTheGreedyActionOfFiveAsOftenAsEpsilonStates) {
  const EnvShape env = shape_of({3, 3, 3, 2, 3});  // the 162 compound actions of Armory Siege
  const std::vector<float> q = {1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0};
  constexpr int kDraws = 20'000;
  constexpr double kEpsilon = 0.1;
  int greedy = 0, single = 0, single_together = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const RngKey key = RngKey(4).split(static_cast<uint64_t>(draw));
    for (const Exploration exploration : {Exploration::kPerHead, Exploration::kAllHeads}) {
      int32_t action[5];
      explore_action(q, {}, env, key, kEpsilon, exploration, action);
      const auto deviating = std::count_if(action, action + 5, [](int32_t choice) { return choice != 0; });
      if (exploration == Exploration::kAllHeads) {
        single_together += deviating == 1;
      } else {
        greedy += deviating == 0;
        single += deviating == 1;
      }
    }
  }
  // A head keeps to its best with 1 - epsilon (1 - 1/size).
  const double of_three = 1 - kEpsilon * 2 / 3, of_two = 1 - kEpsilon / 2;
  const double all_greedy = std::pow(of_three, 4) * of_two;
  const double one = all_greedy * (4 * (1 - of_three) / of_three + (1 - of_two) / of_two);
  EXPECT_NEAR(greedy / double{kDraws}, all_greedy, 0.015);
  EXPECT_NEAR(single / double{kDraws}, one, 0.015);
  EXPECT_NEAR(single_together / double{kDraws}, kEpsilon * 9 / 162, 0.004);  // 9 of 162 differ in one head
}

TEST(ExploreAction, MixesUniformChoicesOfAllHeadsWithTheGreedyAction) {
  const std::vector<float> q = {0.0f, 3.0f, 2.0f, 0.5f, -0.5f};
  constexpr int kDraws = 200'000;
  constexpr float kEpsilon = 0.3f;
  int joint[3][2] = {};
  for (int draw = 0; draw < kDraws; ++draw) {
    int32_t action[2];
    const float log_prob = explore_action(q, {}, kTwoHeads, RngKey(9).split(static_cast<uint64_t>(draw)),
                                          kEpsilon, Exploration::kAllHeads, action);
    ++joint[action[0]][action[1]];
    const bool is_greedy = action[0] == 1 && action[1] == 0;
    EXPECT_NEAR(log_prob, std::log(kEpsilon / 6 + (is_greedy ? 1 - kEpsilon : 0)), 1e-6);
  }
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 2; ++b) {
      const double p = kEpsilon / 6 + (a == 1 && b == 0 ? 1 - kEpsilon : 0);
      EXPECT_NEAR(joint[a][b] / double{kDraws}, p, 5 * std::sqrt(p * (1 - p) / kDraws)) << a << b;
    }
}

TEST(ExploreAction, MasksHoldInExplorationAndGreedyChoice) {
  const std::vector<float> q = {9.0f, 3.0f, 2.0f, 0.5f, 7.0f};
  const std::vector<uint8_t> mask = {0, 1, 1, 1, 0};
  for (const Exploration how : {Exploration::kPerHead, Exploration::kAllHeads}) {
    int counts[3] = {};
    for (uint64_t draw = 0; draw < 3000; ++draw) {
      int32_t action[2];
      explore_action(q, mask, kTwoHeads, RngKey(3).split(draw), 1.0f, how, action);
      EXPECT_NE(action[0], 0);
      EXPECT_EQ(action[1], 0);
      ++counts[action[0]];
      EXPECT_EQ(explore_action(q, mask, kTwoHeads, RngKey(3).split(draw), 0.0f, how, action), 0.0f);
      EXPECT_EQ(action[0], 1);
    }
    EXPECT_NEAR(counts[1] / 3000.0, 0.5, 0.05);
  }
}

}  // namespace action_heads_test
}  // namespace comrad::policy
