#include "learner/estimators/td_targets.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "policy_workers/network/utilities.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace td_targets_test {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Columns of valid steps without ends.
TdInput make_input(const Tensor& reward, const Tensor& next_value) {
  TdInput input;
  input.reward = reward;
  input.next_value = next_value;
  input.terminated = torch::zeros(reward.sizes(), torch::kUInt8);
  input.truncated = torch::zeros(reward.sizes(), torch::kUInt8);
  input.valid = torch::ones(reward.sizes(), torch::kUInt8);
  return input;
}

Tensor column(const std::vector<float>& values) {
  return torch::tensor(values).view({static_cast<int64_t>(values.size()), 1});
}

void expect_values(const Tensor& actual, const std::vector<double>& expected) {
  ASSERT_EQ(actual.numel(), static_cast<int64_t>(expected.size()));
  for (size_t t = 0; t < expected.size(); ++t)
    EXPECT_NEAR(actual.flatten()[static_cast<int64_t>(t)].item<double>(), expected[t], 2e-6) << "entry " << t;
}

/// r = 0.5 and a double-Q next value of (0.2, 0.3), 0.5 together.
TEST(TdTargets, MatchTheKnownAnswers) {
  EnvShape env;
  env.head_count = 2;
  env.head_sizes = {3, 2};
  const Tensor chosen = policy::greedy_action(torch::tensor({0.1f, 0.9f, 0.3f, 1.0f, 0.2f}), {}, env);
  const Tensor target = torch::tensor({0.5f, 0.2f, 0.8f, 0.3f, 0.6f});
  // One target of the sum; one per head of IDQN, which share the reward.
  const TdInput summed = make_input(column({0.5f}), policy::chosen_utility(target, chosen, env).view({1, 1}));
  const TdInput per_head =
      make_input(torch::full({1, 2}, 0.5f), policy::chosen_entries(target, chosen, env).view({1, 2}));
  expect_values(td_targets(summed, {}), {0.995});
  expect_values(td_targets(per_head, {}), {0.698, 0.797});

  TdInput done = summed;
  done.terminated = torch::ones({1, 1}, torch::kUInt8);
  expect_values(td_targets(done, {}), {0.5});
  TdInput timeout = summed;
  timeout.truncated = torch::ones({1, 1}, torch::kUInt8);
  expect_values(td_targets(timeout, {}), {0.995});
  expect_values(td_targets(timeout, {.legacy_timeouts = true}), {0.5});
  timeout.terminated = torch::ones({1, 1}, torch::kUInt8);
  expect_values(td_targets(timeout, {}), {0.5});
}

TEST(TdTargets, OfSeveralStepsMatchSumsDoneByHand) {
  const Tensor reward = column({1, 2, 4, 8}), value = column({10, 20, 30, 40});
  TdInput input = make_input(reward, value);
  expect_values(td_targets(input, {.gamma = 0.5}), {6, 12, 19, 28});
  // 1 + .5*2 + .25*20; 2 + .5*4 + .25*30; 4 + .5*8 + .25*40; the data ends: 8 + .5*40
  expect_values(td_targets(input, {.gamma = 0.5, .n_step = 2}), {7, 11.5, 18, 28});
  expect_values(td_targets(input, {.gamma = 0.5, .n_step = 9}), {6.5, 11, 18, 28});
  // 19 = 4 + .5*30 is cut at step 2 by a time-out; by a termination it is 4.
  input.truncated[2][0] = 1;
  expect_values(td_targets(input, {.gamma = 0.5, .n_step = 9}), {6.75, 11.5, 19, 28});
  input.terminated[2][0] = 1;
  expect_values(td_targets(input, {.gamma = 0.5, .n_step = 9}), {3, 4, 4, 28});
  // lambda = 0.5 backwards: 28; 4; 2 + .5 (.5*20 + .5*4) = 8; 1 + .5 (.5*10 + .5*8) = 5.5
  expect_values(td_targets(input, {.gamma = 0.5, .lambda = 0.5}), {5.5, 8, 4, 28});
}

TEST(TdTargets, LambdaZeroIsOneStepAndLambdaOneRunsToTheEnd) {
  const TdInput input = make_input(column({1, -2, 3, 0.5f}), column({3, 1, 4, 1}));
  EXPECT_TRUE(td_targets(input, {.lambda = 0.0}).equal(td_targets(input, {.n_step = 1})));
  const Tensor difference = td_targets(input, {.lambda = 1.0}) - td_targets(input, {.n_step = 4});
  EXPECT_LT(difference.abs().max().item<double>(), 1e-6);
}

TEST(TdTargets, NeverReadWhatHasNoMeaning) {
  TdInput input = make_input(column({1, kNan, 3, 4}), column({2, kNan, kNan, 5}));
  input.valid[1][0] = 0;
  input.terminated[2][0] = 1;
  for (const TdOptions& options : {TdOptions{.gamma = 0.5}, TdOptions{.gamma = 0.5, .n_step = 3},
                                   TdOptions{.gamma = 0.5, .lambda = 0.8}})
    expect_values(td_targets(input, options), {2, 0, 3, 6.5});
}

TEST(TdTargets, CarryNoGradient) {
  const TdInput input = make_input(column({1, 2}), column({3, 4}).requires_grad_());
  EXPECT_FALSE(td_targets(input, {.n_step = 2}).requires_grad());
}

/// A world that never ends and pays 1 is worth 1 / (1 - gamma); cut by time-outs it still is.
TEST(TdTargets, ATimeOutDoesNotShortenTheFuture) {
  double value = 0;
  for (int sweep = 0; sweep < 2000; ++sweep) {
    TdInput input = make_input(column({1}), column({static_cast<float>(value)}));
    input.truncated[0][0] = 1;
    value = td_targets(input, {}).item<double>();
  }
  EXPECT_NEAR(value, 100, 0.01);
}

/// One target at a time, straight from the definitions.
double plain_target(const TdInput& input, const TdOptions& options, int64_t t, int64_t b) {
  const auto flag = [&](const Tensor& tensor, int64_t at) { return tensor[at][b].item<int>() != 0; };
  const int64_t steps = input.reward.size(0);
  if (!flag(input.valid, t)) return 0;
  const auto terminal = [&](int64_t at) {
    return flag(input.terminated, at) || (options.legacy_timeouts && flag(input.truncated, at));
  };
  // The longest return: steps t .. last.
  int64_t last = t;
  while (last + 1 < steps && !flag(input.terminated, last) && !flag(input.truncated, last) &&
         flag(input.valid, last + 1))
    ++last;
  const auto n_step = [&](int64_t n) {
    double sum = 0, discount = 1;
    const int64_t stop = std::min(t + n - 1, last);
    for (int64_t at = t; at <= stop; ++at, discount *= options.gamma)
      sum += discount * input.reward[at][b].item<double>();
    return terminal(stop) ? sum : sum + discount * input.next_value[stop][b].item<double>();
  };
  double target = 0;
  if (options.lambda < 0) {
    target = n_step(options.n_step);
  } else {
    // (1 - lambda) sum_n lambda^{n-1} G^(n) + lambda^{L-1} G^(L), L steps to the end.
    const int64_t length = last - t + 1;
    double weight = 1;
    for (int64_t n = 1; n < length; ++n, weight *= options.lambda)
      target += (1 - options.lambda) * weight * n_step(n);
    target += weight * n_step(length);
  }
  return target;
}

TEST(TdTargets, MatchPlainLoopsOverRandomSequences) {
  at::Generator draws = at::make_generator<at::CPUGeneratorImpl>(17);
  const auto coin = [&](at::IntArrayRef sizes, double chance) {
    return torch::empty(sizes).uniform_(0, 1, draws).lt(chance).to(torch::kUInt8);
  };
  for (int trial = 0; trial < 60; ++trial) {
    const int64_t steps = 1 + trial % 12, rows = 1 + trial % 4;
    TdInput input = make_input(torch::empty({steps, rows}).normal_(0, 1, draws),
                               torch::empty({steps, rows}).normal_(0, 3, draws));
    input.terminated = coin({steps, rows}, 0.15);
    input.truncated = coin({steps, rows}, 0.15);
    input.valid = coin({steps, rows}, 0.85);
    for (const TdOptions& options :
         {TdOptions{.n_step = 1}, TdOptions{.n_step = 3}, TdOptions{.gamma = 0.8, .n_step = 20},
          TdOptions{.gamma = 0.9, .lambda = 0.0}, TdOptions{.gamma = 0.9, .lambda = 0.7},
          TdOptions{.lambda = 1.0}, TdOptions{.n_step = 5}, TdOptions{.n_step = 4, .legacy_timeouts = true},
          TdOptions{.lambda = 0.6, .legacy_timeouts = true}}) {
      const Tensor target = td_targets(input, options);
      for (int64_t t = 0; t < steps; ++t)
        for (int64_t b = 0; b < rows; ++b)
          EXPECT_NEAR(target[t][b].item<double>(), plain_target(input, options, t, b), 1e-5)
              << "trial " << trial << " n " << options.n_step << " lambda " << options.lambda << " at " << t
              << ", " << b;
    }
  }
}

TEST(Huber, MatchesTheKnownAnswersAndItsSlopeIsAtMostOne) {
  const Tensor error = torch::tensor({0.4f, 1.0f, -2.5f, 0.0f}).requires_grad_();
  const Tensor loss = huber(error);
  expect_values(loss, {0.08, 0.5, 2.0, 0.0});
  loss.sum().backward();
  expect_values(error.grad(), {0.4, 1.0, -1.0, 0.0});
}

}  // namespace td_targets_test
}  // namespace comrad::learn
