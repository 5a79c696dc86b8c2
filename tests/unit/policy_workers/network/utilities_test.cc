#include "policy_workers/network/utilities.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"

namespace comrad::policy {
namespace utilities_test {

/// Armory Siege's heads: 14 logits, 162 compound actions.
EnvShape siege_heads() {
  EnvShape env;
  env.head_count = 5;
  env.head_sizes = {3, 3, 3, 2, 3};
  return env;
}

at::Generator generator(uint64_t seed) { return at::make_generator<at::CPUGeneratorImpl>(seed); }

/// Every compound action, i64 [162, heads].
Tensor all_actions(const EnvShape& env) {
  const Tensor action = torch::empty({env.joint_action_count(), env.head_count}, torch::kInt64);
  for (int64_t row = 0; row < env.joint_action_count(); ++row) {
    int64_t rest = row;
    for (int32_t head = 0; head < env.head_count; ++head) {
      action[row][head] = rest % env.head_sizes[static_cast<size_t>(head)];
      rest /= env.head_sizes[static_cast<size_t>(head)];
    }
  }
  return action;
}

/// The best value and its action among compound actions whose every choice the mask allows, by plain loops.
struct BruteForce {
  double value = -1e30;
  std::vector<int64_t> action;
};
BruteForce best_of_all(const Tensor& q, const Tensor& mask, const EnvShape& env) {
  BruteForce best;
  const Tensor actions = all_actions(env);
  for (int64_t row = 0; row < actions.size(0); ++row) {
    double value = 0;
    bool allowed = true;
    std::vector<int64_t> action;
    int64_t first = 0;
    for (int32_t head = 0; head < env.head_count; ++head) {
      const int64_t choice = actions[row][head].item<int64_t>();
      value += q[first + choice].item<double>();
      allowed = allowed && (!mask.defined() || mask[first + choice].item<uint8_t>() != 0);
      action.push_back(choice);
      first += env.head_sizes[static_cast<size_t>(head)];
    }
    if (allowed && value > best.value) best = {value, action};
  }
  return best;
}

TEST(GreedyUtility, IsTheMaximumOverAllCompoundActions) {
  const EnvShape env = siege_heads();
  ASSERT_EQ(env.joint_action_count(), 162);
  at::Generator draws = generator(1);
  for (int trial = 0; trial < 10; ++trial) {
    const Tensor q = torch::empty({env.logit_count()}).normal_(0, 1, draws);
    const BruteForce best = best_of_all(q, {}, env);
    const Tensor action = greedy_action(q, {}, env);
    EXPECT_NEAR(greedy_utility(q, {}, env).item<double>(), best.value, 1e-5);
    EXPECT_TRUE(action.equal(torch::tensor(best.action)));
    EXPECT_NEAR(chosen_utility(q, action, env).item<double>(), best.value, 1e-5);
  }
}

TEST(GreedyUtility, NeverTakesAMaskedChoice) {
  const EnvShape env = siege_heads();
  at::Generator draws = generator(2);
  for (int trial = 0; trial < 10; ++trial) {
    const Tensor q = torch::empty({env.logit_count()}).normal_(0, 1, draws);
    // All choices of some heads are worth less than nothing: masks must not let a 0 through either.
    if (trial % 2 == 0) q.sub_(100);
    Tensor mask = torch::empty({env.logit_count()}).uniform_(0, 1, draws).gt(0.5).to(torch::kUInt8);
    int64_t first = 0;
    for (int32_t head = 0; head < env.head_count; ++head) {
      mask[first + trial % env.head_sizes[static_cast<size_t>(head)]] = 1;
      first += env.head_sizes[static_cast<size_t>(head)];
    }
    const BruteForce best = best_of_all(q, mask, env);
    EXPECT_TRUE(greedy_action(q, mask, env).equal(torch::tensor(best.action)));
    EXPECT_NEAR(greedy_utility(q, mask, env).item<double>(), best.value, 1e-4);
  }
}

TEST(GreedyAction, AHeadWithoutAllowedChoicesCountsAsUnmasked) {
  EnvShape env;
  env.head_count = 2;
  env.head_sizes = {3, 2};
  const Tensor q = torch::tensor({1.0f, 3.0f, 2.0f, 5.0f, 4.0f});
  const Tensor mask = torch::tensor({0, 0, 0, 0, 1}, torch::kUInt8);
  EXPECT_TRUE(greedy_action(q, mask, env).equal(torch::tensor({int64_t{1}, int64_t{1}})));
  EXPECT_EQ(greedy_utility(q, mask, env).item<float>(), 7.0f);
}

TEST(GreedyAction, TakesTheFirstOfEqualChoices) {
  EnvShape env;
  env.head_count = 1;
  env.head_sizes = {5};
  EXPECT_EQ(greedy_action(torch::tensor({1.0f, 2.0f, 2.0f, 2.0f, 0.0f}), {}, env).item<int64_t>(), 1);
  EXPECT_EQ(
      greedy_action(torch::zeros({5}), torch::tensor({0, 0, 1, 1, 0}, torch::kUInt8), env).item<int64_t>(),
      2);
}

TEST(ChosenEntries, AreOnePerHeadOfEveryRow) {
  EnvShape env;
  env.head_count = 2;
  env.head_sizes = {3, 2};
  const Tensor q = torch::arange(20, torch::kFloat32).view({2, 2, 5}).requires_grad_();
  const Tensor action = torch::tensor({0, 1, 2, 0, 1, 1, 2, 1}, torch::kInt64).view({2, 2, 2});
  const Tensor values = chosen_entries(q, action, env);
  EXPECT_TRUE(values.equal(torch::tensor({0.f, 4.f, 7.f, 8.f, 11.f, 14.f, 17.f, 19.f}).view({2, 2, 2})));
  EXPECT_TRUE(chosen_utility(q, action, env).equal(torch::tensor({4.f, 15.f, 25.f, 36.f}).view({2, 2})));
  chosen_utility(q, action, env).sum().backward();
  EXPECT_TRUE(q.grad().equal(multi_hot(action, env)));
}

TEST(MultiHot, DistinguishesAllCompoundActions) {
  const EnvShape env = siege_heads();
  const Tensor hot = multi_hot(all_actions(env), env);
  ASSERT_EQ(hot.sizes(), torch::IntArrayRef({162, 14}));
  EXPECT_TRUE(hot.sum(1).eq(5).all().item<bool>());
  EXPECT_TRUE(hot.eq(0).logical_or(hot.eq(1)).all().item<bool>());
  std::set<std::vector<float>> codes;
  for (int64_t row = 0; row < hot.size(0); ++row)
    codes.insert(std::vector<float>(hot[row].data_ptr<float>(), hot[row].data_ptr<float>() + 14));
  EXPECT_EQ(codes.size(), 162u);
}

/// Double Q: the online network chooses, the target network values.
TEST(DoubleQ, ValuesTheOnlineChoiceByTheTargetHeadByHead) {
  EnvShape env;
  env.head_count = 2;
  env.head_sizes = {3, 2};
  const Tensor online = torch::tensor({0.1f, 0.9f, 0.3f, 1.0f, 0.2f});
  const Tensor target = torch::tensor({0.5f, 0.2f, 0.8f, 0.3f, 0.6f});
  const Tensor chosen = greedy_action(online, {}, env);
  EXPECT_TRUE(chosen_entries(target, chosen, env).equal(torch::tensor({0.2f, 0.3f})));
  EXPECT_NEAR(chosen_utility(target, chosen, env).item<double>(), 0.5, 1e-6);
  EXPECT_NEAR(greedy_utility(target, {}, env).item<double>(), 1.4, 1e-6);
}

}  // namespace utilities_test
}  // namespace comrad::policy
