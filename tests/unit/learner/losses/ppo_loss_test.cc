#include "learner/losses/ppo_loss.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"

namespace comrad::learn {
namespace ppo_loss_test {

EnvShape two_heads() {
  EnvShape env;
  env.head_count = 2;
  env.head_sizes = {3, 2};
  return env;
}

double objective(double ratio, double advantage) {
  const Tensor clamped = importance_ratio(torch::tensor(std::log(ratio)), torch::tensor(0.0));
  return clipped_objective(clamped, torch::tensor(advantage),
                           ClipInterval::of(torch::tensor(0.1, torch::kFloat64)))
      .item<double>();
}

TEST(PpoLoss, ObjectiveMatchesTheKnownAnswers) {
  const double expected[][3] = {
      {0.5, 0.5, -0.909091}, {0.9, 0.9, -0.909091}, {1.05, 1.05, -1.05}, {1.3, 1.1, -1.3}, {30, 1.1, -20}};
  for (const auto& [ratio, gain, loss] : expected) {
    EXPECT_NEAR(objective(ratio, 1), gain, 1e-6) << "ratio " << ratio;
    EXPECT_NEAR(objective(ratio, -1), loss, 2e-6) << "ratio " << ratio;
  }
}

TEST(PpoLoss, ValueLossMatchesTheKnownAnswers) {
  const double expected[][4] = {
      {1.5, 1, 2, 0.32}, {1.1, 1, 2, 0.405}, {0.2, 1, 2, 1.62}, {1.5, 1, 1.2, 0.045}};
  for (const auto& [value, old_value, target, loss] : expected) {
    const Tensor per_sample =
        clipped_value_loss(torch::tensor(value), torch::tensor(old_value), torch::tensor(target), 0.2);
    EXPECT_NEAR(0.5 * per_sample.item<double>(), loss, 1e-6);
  }
}

TEST(PpoLoss, TwoHeadPolicyMatchesTheKnownAnswers) {
  const EnvShape env = two_heads();
  const Tensor logits = torch::tensor({0.0f, 1.0f, 2.0f, 0.5f, -0.5f}).view({1, 5});
  const Tensor log_probs = policy::head_log_probs(logits, {}, env);
  const double probs[] = {0.090031, 0.244728, 0.665241, 0.731059, 0.268941};
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(std::exp(log_probs[0][i].item<double>()), probs[i], 1e-6);
  const auto log_prob = [&](int64_t first, int64_t second) {
    return policy::action_log_prob(log_probs, torch::tensor({first, second}).view({1, 2}), env)
        .item<double>();
  };
  EXPECT_NEAR(log_prob(2, 0), -0.720868, 1e-6);
  EXPECT_NEAR(log_prob(0, 1), -3.720868, 1e-6);
  EXPECT_NEAR(exploration_loss(log_probs, {}, env, ExplorationLoss::kSymmetricKl).item<double>(), 0.403134,
              1e-6);
  EXPECT_NEAR(exploration_loss(log_probs, {}, env, ExplorationLoss::kEntropy).item<double>(), -1.414599,
              1e-6);
  EXPECT_EQ(exploration_loss(log_probs, {}, env, ExplorationLoss::kNone).item<double>(), 0);
}

TEST(PpoLoss, ExplorationLossIsCappedAndSendsNoGradientAboveTheCap) {
  EnvShape env;
  env.head_count = 1;
  env.head_sizes = {2};
  const Tensor logits = torch::tensor({0.0f, -500.0f}).view({1, 2}).requires_grad_();
  const Tensor loss =
      exploration_loss(policy::head_log_probs(logits, {}, env), {}, env, ExplorationLoss::kSymmetricKl).sum();
  EXPECT_EQ(loss.item<double>(), kExplorationLossMax);
  loss.backward();
  EXPECT_EQ(logits.grad().abs().max().item<double>(), 0);
}

TEST(PpoLoss, StandardizeUsesTheUnbiasedDeviationOfValidSamples) {
  const Tensor standard =
      standardize(torch::tensor({1.0f, -0.5f, 77.0f, 2.0f}), torch::tensor({1, 1, 0, 1}, torch::kUInt8));
  const double expected[] = {0.132453, -1.059626, 0, 0.927173};
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(standard[i].item<double>(), expected[i], 1e-6);
}

TEST(PpoLoss, AFloorKeepsSmallAdvantagesSmall) {
  const Tensor advantage = torch::tensor({1.0f, -0.5f, 77.0f, 2.0f});  // deviation 1.2583 of those that count
  const Tensor valid = torch::tensor({1, 1, 0, 1}, torch::kUInt8);
  EXPECT_TRUE(torch::equal(standardize(advantage, valid, 1.2), standardize(advantage, valid)));
  const Tensor floored = standardize(advantage, valid, 10);
  const double expected[] = {0.0166667, -0.1333333, 0, 0.1166667};
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(floored[i].item<double>(), expected[i], 1e-6);
}

TEST(PpoLoss, StandardizeSurvivesEqualSingleAndMissingSamples) {
  const Tensor ones = torch::ones({3}, torch::kUInt8);
  EXPECT_EQ(standardize(torch::full({3}, 4.0f), ones).abs().max().item<float>(), 0);
  EXPECT_EQ(standardize(torch::tensor({5.0f}), torch::ones({1}, torch::kUInt8)).item<float>(), 0);
  EXPECT_EQ(standardize(torch::tensor({5.0f}), torch::zeros({1}, torch::kUInt8)).item<float>(), 0);
}

}  // namespace ppo_loss_test
}  // namespace comrad::learn
