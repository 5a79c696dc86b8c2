#include "learner/algorithms/adam_optimizer.h"

#include <gtest/gtest.h>

#include <limits>

#include "policy_workers/policy/torch_ops.h"

namespace comrad::learn {
namespace {

TEST(AdamOptimizer, MatchesTheKnownAnswer) {
  torch::Tensor p = torch::ones({1}, torch::kFloat64).requires_grad_();
  AdamOptimizer optimizer({p}, {});
  p.mutable_grad() = torch::full({1}, 0.01, torch::kFloat64);
  optimizer.step(1e-4);
  EXPECT_NEAR(p.item<double>(), 0.9999000100, 1e-10);
  p.mutable_grad() = torch::full({1}, -0.02, torch::kFloat64);
  optimizer.step(1e-4);
  EXPECT_NEAR(p.item<double>(), 0.9999366180, 1e-10);
}

TEST(AdamOptimizer, ClipsTheGlobalNormToFour) {
  torch::Tensor a = torch::zeros({1}).requires_grad_(), b = torch::zeros({1}).requires_grad_();
  AdamOptimizer optimizer({a, b}, {.max_grad_norm = 4.0});
  a.mutable_grad() = torch::tensor({3.0f});
  b.mutable_grad() = torch::tensor({4.0f});
  EXPECT_NEAR(optimizer.clip_gradients(), 5.0, 1e-6);
  EXPECT_NEAR(a.grad().item<double>(), 2.3999995, 3e-7);
  EXPECT_NEAR(b.grad().item<double>(), 3.1999994, 3e-7);
}

TEST(AdamOptimizer, LeavesSmallAndNonFiniteGradientsAlone) {
  torch::Tensor a = torch::zeros({2}).requires_grad_();
  AdamOptimizer optimizer({a}, {.max_grad_norm = 4.0});
  a.mutable_grad() = torch::tensor({0.5f, -0.5f});
  optimizer.clip_gradients();
  EXPECT_EQ(a.grad()[0].item<float>(), 0.5f);
  a.mutable_grad() = torch::tensor({std::numeric_limits<float>::infinity(), 1.0f});
  EXPECT_FALSE(std::isfinite(optimizer.clip_gradients()));
  EXPECT_EQ(a.grad()[1].item<float>(), 1.0f);
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

}  // namespace
}  // namespace comrad::learn
