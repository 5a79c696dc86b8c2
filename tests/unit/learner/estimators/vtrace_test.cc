#include "learner/estimators/vtrace.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace vtrace_test {

ReturnInput common_input() {
  ReturnInput input;
  input.reward = torch::tensor({1.0f, 0.0f, 2.0f}).view({3, 1});
  input.value = torch::tensor({0.5f, 0.4f, 0.3f, 0.2f}).view({4, 1});
  input.terminated = torch::zeros({3, 1}, torch::kUInt8);
  input.truncated = torch::zeros({3, 1}, torch::kUInt8);
  input.final_value = torch::zeros({3, 1});
  return input;
}

void expect_column(const Tensor& actual, const std::vector<double>& expected) {
  for (std::size_t t = 0; t < expected.size(); ++t)
    EXPECT_NEAR(actual[static_cast<int64_t>(t)][0].item<double>(), expected[t], 5e-6) << "at step " << t;
}

TEST(Vtrace, OnPolicyIsGaeWithLambdaOne) {
  const Advantages result = vtrace(torch::zeros({3, 1}), common_input(), {});
  expect_column(result.target, {3.15426, 2.17602, 2.198});
  expect_column(result.advantage, {2.65426, 1.77602, 1.898});
}

TEST(Vtrace, CapsTheRatios) {
  const Tensor log_rho = torch::tensor({0.5f, 2.0f, 1.5f}).log().view({3, 1});
  const Advantages result = vtrace(log_rho, common_input(), {});
  expect_column(result.target, {1.82713, 2.17602, 2.198});
  expect_column(result.advantage, {1.32713, 1.77602, 1.898});
}

TEST(Vtrace, StopsAtATermination) {
  const Tensor log_rho = torch::tensor({0.5f, 2.0f, 1.5f}).log().view({3, 1});
  ReturnInput input = common_input();
  input.terminated[1][0] = 1;
  const Advantages result = vtrace(log_rho, input, {});
  expect_column(result.target, {0.75, 0, 2.198});
  expect_column(result.advantage, {0.25, -0.4, 1.898});
}

TEST(Vtrace, BootstrapsFromTheFinalObservationAtATimeOut) {
  ReturnInput input = common_input();
  input.truncated[1][0] = 1;
  input.final_value[1][0] = 0.7f;
  const Advantages result = vtrace(torch::zeros({3, 1}), input, {});
  expect_column(result.target, {1 + 0.99 * 0.693, 0.693, 2.198});
  expect_column(result.advantage, {0.5 + 0.99 * 0.693, 0.293, 1.898});
}

TEST(Vtrace, MatchesTheSumOfEquation1) {
  // vs_s = V_s + sum_t gamma^{t-s} (prod_{i<t} c_i) rho_t (r_t + gamma V_{t+1} - V_t)
  Rng rng(11);
  const int64_t steps = 9;
  const double gamma = 0.95;
  ReturnInput input;
  input.reward = torch::empty({steps, 1});
  input.value = torch::empty({steps + 1, 1});
  input.terminated = torch::zeros({steps, 1}, torch::kUInt8);
  input.truncated = torch::zeros({steps, 1}, torch::kUInt8);
  input.final_value = torch::zeros({steps, 1});
  Tensor log_rho = torch::empty({steps, 1});
  for (int64_t t = 0; t <= steps; ++t) {
    input.value[t][0] = rng.uniform();
    if (t == steps) break;
    input.reward[t][0] = rng.uniform();
    log_rho[t][0] = 2 * rng.uniform() - 1;
  }
  const Advantages result = vtrace(log_rho, input, {.gamma = gamma});
  for (int64_t s = 0; s < steps; ++s) {
    double sum = input.value[s][0].item<double>(), weight = 1;
    for (int64_t t = s; t < steps; ++t) {
      const double clipped = std::min(1.0, std::exp(log_rho[t][0].item<double>()));
      sum += weight * clipped *
             (input.reward[t][0].item<double>() + gamma * input.value[t + 1][0].item<double>() -
              input.value[t][0].item<double>());
      weight *= gamma * clipped;
    }
    EXPECT_NEAR(result.target[s][0].item<double>(), sum, 1e-5);
  }
}

}  // namespace vtrace_test
}  // namespace comrad::learn
