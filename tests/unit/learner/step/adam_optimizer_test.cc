#include "learner/step/adam_optimizer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace adam_optimizer_test {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

TEST(AdamOptimizer, MatchesTheKnownAnswer) {
  for (const auto type : {torch::kFloat64, torch::kFloat32}) {  // as operators, and as the CPU's own loop
    const double tolerance = type == torch::kFloat64 ? 1e-10 : 1e-7;
    torch::Tensor p = torch::ones({1}, type).requires_grad_();
    AdamOptimizer optimizer({p}, {});
    p.mutable_grad() = torch::full({1}, 0.01, type);
    optimizer.step(1e-4);
    EXPECT_NEAR(p.item<double>(), 0.9999000100, tolerance);
    p.mutable_grad() = torch::full({1}, -0.02, type);
    optimizer.step(1e-4);
    EXPECT_NEAR(p.item<double>(), 0.9999366180, tolerance);
  }
}

/// Parameters after three steps with a clip that acts, and what the steps said.
std::pair<torch::Tensor, torch::Tensor> after_three_steps(torch::ScalarType type) {
  torch::Tensor a = torch::arange(37, torch::kFloat32).to(type).requires_grad_(),
                b = torch::full({3, 5}, -2.0, type).requires_grad_();
  AdamOptimizer optimizer({a, b}, {.max_grad_norm = 0.7});
  torch::Tensor said;
  for (int step = 1; step <= 3; ++step) {
    a.mutable_grad() = (torch::arange(37, torch::kFloat32) * 0.01f * static_cast<float>(step)).to(type);
    b.mutable_grad() = torch::full({3, 5}, -0.02 * step, type);
    said = optimizer.step(1e-2, torch::ones({}));
  }
  return {at::cat({a.detach().to(torch::kFloat64), b.detach().flatten().to(torch::kFloat64)}), said};
}

TEST(AdamOptimizer, TheLoopOfTheCpuAndTheOperatorsOfADeviceTakeTheSameSteps) {
  const auto [by_loop, said_by_loop] = after_three_steps(torch::kFloat32);
  const auto [by_operators, said_by_operators] = after_three_steps(torch::kFloat64);
  EXPECT_LT((by_loop - by_operators).abs().max().item<double>(), 5e-6);
  EXPECT_LT((said_by_loop - said_by_operators).abs().max().item<double>(), 1e-6);
}

TEST(AdamOptimizer, ClipsTheGlobalNormToFour) {
  // An epsilon that dwarfs the gradient makes a first step of lr g / epsilon, in which a clip shows.
  for (const auto type : {torch::kFloat64, torch::kFloat32}) {
    torch::Tensor a = torch::zeros({1}, type).requires_grad_(), b = torch::zeros({1}, type).requires_grad_();
    AdamOptimizer optimizer({a, b}, {.epsilon = 1e9, .max_grad_norm = 4.0});
    a.mutable_grad() = torch::full({1}, 3.0, type);
    b.mutable_grad() = torch::full({1}, 4.0, type);
    EXPECT_NEAR(optimizer.step(1e9)[1].item<double>(), 5.0, 1e-6);
    EXPECT_NEAR(a.item<double>(), -2.3999995, 1e-6);
    EXPECT_NEAR(b.item<double>(), -3.1999994, 1e-6);
    EXPECT_EQ(a.grad().item<double>(), 3.0) << "the gradient stays for reports";
  }
}

TEST(AdamOptimizer, WhatIsNotFiniteMovesNothing) {
  for (const auto type : {torch::kFloat64, torch::kFloat32}) {
    torch::Tensor a = torch::zeros({2}, type).requires_grad_();
    AdamOptimizer optimizer({a}, {.max_grad_norm = 4.0});
    a.mutable_grad() = torch::full({2}, 0.5, type);
    EXPECT_EQ(optimizer.step(1e-2, torch::ones({}))[0].item<double>(), 1);
    const torch::Tensor before = a.detach().clone();
    EXPECT_EQ(optimizer.step(1e-2, torch::full({}, std::nanf("")))[0].item<double>(), 0);
    EXPECT_TRUE(torch::equal(a.detach(), before));
    a.mutable_grad() = torch::tensor({kInfinity, 1.0f}).to(type);
    EXPECT_EQ(optimizer.step(1e-2, torch::ones({}))[0].item<double>(), 0);
    EXPECT_TRUE(torch::equal(a.detach(), before));
    // And the next sound step is the second one, not the fourth.
    torch::Tensor other = torch::zeros({2}, type).requires_grad_();
    AdamOptimizer undisturbed({other}, {.max_grad_norm = 4.0});
    other.mutable_grad() = torch::full({2}, 0.5, type);
    undisturbed.step(1e-2);
    undisturbed.step(1e-2);
    a.mutable_grad() = torch::full({2}, 0.5, type);
    optimizer.step(1e-2);
    EXPECT_TRUE(torch::equal(a.detach(), other.detach()));
  }
}

TEST(AdamOptimizer, StepsAlikeWithAnyNumberOfThreads) {
  const int before = at::get_num_threads();
  const auto after_a_step = [](int threads) {
    device::set_math_threads(threads);
    torch::manual_seed(3);
    torch::Tensor a = torch::randn({700, 300}).requires_grad_(), b = torch::randn({5}).requires_grad_();
    AdamOptimizer optimizer({a, b}, {.max_grad_norm = 0.7});
    a.mutable_grad() = torch::randn({700, 300});
    b.mutable_grad() = torch::randn({5});
    const torch::Tensor norm = optimizer.step(1e-2)[1];
    return at::cat({a.detach().flatten(), b.detach()}).to(torch::kFloat64) * norm;
  };
  const torch::Tensor alone = after_a_step(1);
  EXPECT_TRUE(torch::equal(alone, after_a_step(2)));
  EXPECT_TRUE(torch::equal(alone, after_a_step(5)));
  device::set_math_threads(before);
}

TEST(AdamOptimizer, AReloadedOptimizerTakesTheSameNextStep) {
  const auto run = [](bool reload) {
    torch::Tensor p = torch::arange(6, torch::kFloat32).view({2, 3}).requires_grad_();
    AdamOptimizer optimizer({p}, {});
    for (int i = 0; i < 3; ++i) {
      p.mutable_grad() = torch::full({2, 3}, 0.1f * static_cast<float>(i + 1));
      optimizer.step(1e-2);
    }
    StateDict state;
    optimizer.save(state, "optimizer");
    if (reload) {
      optimizer = AdamOptimizer({p}, {});
      EXPECT_TRUE(optimizer.load(state, "optimizer"));
    }
    p.mutable_grad() = torch::full({2, 3}, -0.3f);
    optimizer.step(1e-2);
    return p.detach();
  };
  EXPECT_TRUE(torch::equal(run(true), run(false)));
}

TEST(AdamOptimizer, AParameterWithClearedMomentsStepsAsAFreshOne) {
  for (const auto type : {torch::kFloat64, torch::kFloat32}) {
    const auto gradient = [type](int step) { return torch::full({3}, 0.1 * step - 0.25, type); };
    for (const bool reload : {false, true}) {
      torch::Tensor kept = torch::zeros({3}, type).requires_grad_(),
                    cleared = torch::zeros({3}, type).requires_grad_();
      AdamOptimizer optimizer({kept, cleared}, {.max_grad_norm = 0});
      const auto step = [&](int number) {
        kept.mutable_grad() = gradient(number);
        cleared.mutable_grad() = gradient(number);
        optimizer.step(1e-2);
      };
      for (int number = 1; number <= 4; ++number) step(number);
      const torch::Tensor start = cleared.detach().clone();
      optimizer.clear_moments(1);
      EXPECT_EQ(optimizer.step_multiplier(1), 0);
      step(5);
      if (reload) {
        StateDict state;
        optimizer.save(state, "optimizer");
        EXPECT_EQ(state.integer("optimizer/000.step").value(), 5);
        EXPECT_EQ(state.integer("optimizer/001.step").value(), 1);
        optimizer = AdamOptimizer({kept, cleared}, {.max_grad_norm = 0});
        ASSERT_TRUE(optimizer.load(state, "optimizer"));
      }
      step(6);
      torch::Tensor all = torch::zeros({3}, type).requires_grad_(), fresh = start.clone().requires_grad_();
      AdamOptimizer undisturbed({all}, {.max_grad_norm = 0}), new_one({fresh}, {.max_grad_norm = 0});
      for (int number = 1; number <= 6; ++number) {
        all.mutable_grad() = gradient(number);
        undisturbed.step(1e-2);
        if (number < 5) continue;
        fresh.mutable_grad() = gradient(number);
        new_one.step(1e-2);
      }
      EXPECT_TRUE(torch::equal(kept.detach(), all.detach()));
      EXPECT_TRUE(torch::equal(cleared.detach(), fresh.detach()));
    }
  }
}

TEST(AdamOptimizer, RefusesMomentsOfAnotherShape) {
  torch::Tensor p = torch::zeros({4}).requires_grad_(), q = torch::zeros({5}).requires_grad_();
  AdamOptimizer of_p({p}, {}), of_q({q}, {});
  p.mutable_grad() = torch::ones({4});
  of_p.step(1e-3);
  StateDict state;
  of_p.save(state, "optimizer");
  const Status loaded = of_q.load(state, "optimizer");
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::kBadFormat);
  EXPECT_NE(loaded.error().message.find("[5]"), std::string::npos) << loaded.error().message;
}

}  // namespace adam_optimizer_test
}  // namespace comrad::learn
