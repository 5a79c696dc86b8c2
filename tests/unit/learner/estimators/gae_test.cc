#include "learner/estimators/gae.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace gae_test {

/// One trajectory without ends, all valid.
ReturnInput make_input(const std::vector<float>& reward, const std::vector<float>& value) {
  const int64_t steps = static_cast<int64_t>(reward.size());
  ReturnInput input;
  input.reward = torch::tensor(reward).view({steps, 1});
  input.value = torch::tensor(value).view({steps + 1, 1});
  input.terminated = torch::zeros({steps, 1}, torch::kUInt8);
  input.truncated = torch::zeros({steps, 1}, torch::kUInt8);
  input.final_value = torch::zeros({steps, 1});
  input.valid = torch::ones({steps, 1}, torch::kUInt8);
  input.value_valid = torch::ones({steps + 1, 1}, torch::kUInt8);
  return input;
}

ReturnInput common_input() { return make_input({1, 0, 2}, {0.5f, 0.4f, 0.3f, 0.2f}); }

void expect_column(const Tensor& actual, const std::vector<double>& expected) {
  ASSERT_EQ(actual.size(0), static_cast<int64_t>(expected.size()));
  for (std::size_t t = 0; t < expected.size(); ++t)
    EXPECT_NEAR(actual[static_cast<int64_t>(t)][0].item<double>(), expected[t], 2e-6) << "at step " << t;
}

TEST(Gae, MatchesTheKnownAnswer) {
  const Advantages result = gae(common_input(), {.gamma = 0.99, .lambda = 0.95});
  expect_column(result.advantage, {2.477986, 1.682069, 1.898});
  expect_column(result.target, {2.977986, 2.082069, 2.198});
}

TEST(Gae, StopsAtATermination) {
  ReturnInput input = common_input();
  input.terminated[1][0] = 1;
  const Advantages result = gae(input, {});
  expect_column(result.advantage, {0.5198, -0.4, 1.898});
  expect_column(result.target, {1.0198, 0, 2.198});
}

TEST(Gae, LambdaOneIsTheDiscountedReturnAndLambdaZeroTheTdError) {
  expect_column(gae(common_input(), {.lambda = 1.0}).advantage, {2.654260, 1.776020, 1.898});
  expect_column(gae(common_input(), {.lambda = 0.0}).advantage, {0.896, -0.103, 1.898});
}

TEST(Gae, IgnoresTheValueBehindATerminatedLastStep) {
  ReturnInput input = make_input({1, 0, 2, -1}, {0.5f, 0.4f, 0.3f, 0.2f, 9.0f});
  input.terminated[3][0] = 1;
  expect_column(gae(input, {}).advantage, {1.479694, 0.620621, 0.7694, -1.2});
}

TEST(Gae, BootstrapsFromTheFinalObservationAtATimeOut) {
  ReturnInput input = common_input();
  input.truncated[1][0] = 1;
  input.final_value[1][0] = 0.7f;
  expect_column(gae(input, {}).advantage, {1.171566, 0.293, 1.898});
}

TEST(Gae, LegacyTimeoutsAreTerminal) {
  ReturnInput input = common_input();
  input.truncated[1][0] = 1;
  input.final_value[1][0] = 0.7f;
  expect_column(gae(input, {.legacy_timeouts = true}).advantage, {0.5198, -0.4, 1.898});
}

TEST(Gae, AStepThatBothTerminatedAndRanOutOfTimeIsTerminal) {
  ReturnInput input = common_input();
  input.truncated[1][0] = 1;
  input.terminated[1][0] = 1;
  input.final_value[1][0] = 0.7f;
  expect_column(gae(input, {}).advantage, {0.5198, -0.4, 1.898});
}

TEST(Gae, AnInvalidStepIsTransparent) {
  ReturnInput input = common_input();
  input.valid[1][0] = 0;
  input.value_valid[1][0] = 0;
  const double gamma = 0.99, lambda = 0.95;
  const double last = 1.898;
  const double middle = gamma * 0.3 + last;  // delta has only the bootstrap, the factor is 1
  const double first = (1 - 0.5) + gamma * lambda * middle;
  expect_column(gae(input, {}).advantage, {first, middle, last});
}

TEST(Gae, AgreesWithTheFormulaWrittenAsNestedSums) {
  // A_t = sum_l (prod_{j<l} f_j) delta_{t+l}, with factors and deltas written straight from the definition.
  Rng rng(7);
  const int64_t steps = 13, rows = 5;
  const double gamma = 0.97, lambda = 0.9;
  ReturnInput input;
  input.reward = torch::empty({steps, rows});
  input.value = torch::empty({steps + 1, rows});
  input.final_value = torch::empty({steps, rows});
  input.terminated = torch::zeros({steps, rows}, torch::kUInt8);
  input.truncated = torch::zeros({steps, rows}, torch::kUInt8);
  input.valid = torch::ones({steps, rows}, torch::kUInt8);
  input.value_valid = torch::ones({steps + 1, rows}, torch::kUInt8);
  for (int64_t t = 0; t <= steps; ++t)
    for (int64_t b = 0; b < rows; ++b) {
      input.value[t][b] = rng.uniform() * 2 - 1;
      if (t == steps) {
        input.value_valid[t][b] = input.valid[t - 1][b];
        continue;
      }
      input.reward[t][b] = rng.uniform() * 2 - 1;
      input.final_value[t][b] = rng.uniform() * 2 - 1;
      input.terminated[t][b] = rng.below(6) == 0 ? 1 : 0;
      input.truncated[t][b] = rng.below(6) == 0 ? 1 : 0;
      input.valid[t][b] = input.value_valid[t][b] = rng.below(5) == 0 ? 0 : 1;
    }
  const Advantages result = gae(input, {.gamma = gamma, .lambda = lambda});
  const auto at = [](const Tensor& tensor, int64_t t, int64_t b) { return tensor[t][b].item<double>(); };
  for (int64_t b = 0; b < rows; ++b) {
    for (int64_t t = 0; t < steps; ++t) {
      double sum = 0, weight = 1;
      for (int64_t k = t; k < steps; ++k) {
        const double d = std::max(at(input.terminated, k, b), at(input.truncated, k, b));
        const double cut = at(input.truncated, k, b) * (1 - at(input.terminated, k, b));
        const double v = at(input.valid, k, b);
        sum += weight * ((at(input.reward, k, b) - at(input.value, k, b)) * v +
                         (1 - d) * gamma * at(input.value, k + 1, b) * at(input.value_valid, k + 1, b) +
                         cut * gamma * at(input.final_value, k, b) * v);
        weight *= (1 - d) * (v > 0 ? gamma * lambda : 1.0);
      }
      EXPECT_NEAR(at(result.advantage, t, b), sum, 1e-5) << "t " << t << " b " << b;
    }
  }
}

}  // namespace gae_test
}  // namespace comrad::learn
