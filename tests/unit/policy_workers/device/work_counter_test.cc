#include "policy_workers/device/work_counter.h"

#include <gtest/gtest.h>

#include "policy_workers/policy/torch_ops.h"

namespace comrad::device {
namespace work_counter_test {

TEST(WorkCounter, AProductAndItsGradients) {
  const torch::Tensor x = torch::randn({6, 5}), w = torch::randn({7, 5}).requires_grad_(),
                      b = torch::randn({7});
  const WorkCounter counter;
  const torch::Tensor y = at::linear(x, w, b);
  EXPECT_EQ(counter.of(Phase::kForward).flop, 2 * 6 * 5 * 7);
  EXPECT_EQ(counter.of(Phase::kForward).launches, 1) << "the transposed view is no work";
  EXPECT_EQ(counter.of(Phase::kForward).bytes, 4 * (6 * 5 + 7 * 5 + 7 + 6 * 7));
  EXPECT_EQ(counter.of(Phase::kBackward).launches, 0);
  y.sum().backward();
  EXPECT_EQ(counter.of(Phase::kBackward).flop, 2 * 6 * 5 * 7) << "of the weight alone: x wants no gradient";
  EXPECT_EQ(counter.of(Phase::kOptimizer).launches, 0);
}

TEST(WorkCounter, AConvolutionCountsItsProductsOnce) {
  const torch::Tensor x = torch::randn({2, 3, 9, 9}).requires_grad_(),
                      w = torch::randn({4, 3, 3, 3}).requires_grad_();
  const WorkCounter counter;
  const torch::Tensor y = at::conv2d(x, w, torch::Tensor(), 2);
  constexpr int64_t kFlop = 2 * (2 * 4 * 4 * 4) * (3 * 3 * 3);
  EXPECT_EQ(counter.of(Phase::kForward).flop, kFlop);
  y.sum().backward();
  EXPECT_EQ(counter.of(Phase::kForward).flop, kFlop);
  EXPECT_EQ(counter.of(Phase::kBackward).flop, 2 * kFlop) << "gradients of x and of w";
}

TEST(WorkCounter, ViewsAndAllocationsAreNoWorkAndListsAreOne) {
  std::vector<torch::Tensor> list = {torch::ones({8}), torch::ones({3})};
  const WorkCounter counter;
  const torch::Tensor x = torch::empty({4, 4});
  (void)x.view({2, 8}).t().slice(0, 0, 1).unsqueeze(0);
  EXPECT_EQ(counter.of(Phase::kForward).launches, 0);
  {
    const OptimizerScope scope;
    at::_foreach_add_(list, 1);
  }
  EXPECT_EQ(counter.of(Phase::kForward).launches, 0);
  EXPECT_EQ(counter.of(Phase::kOptimizer).launches, 1);
  EXPECT_GE(counter.of(Phase::kOptimizer).bytes, 4 * 11);
  EXPECT_EQ(counter.of(Phase::kOptimizer).flop, 0);
}

}  // namespace work_counter_test
}  // namespace comrad::device
