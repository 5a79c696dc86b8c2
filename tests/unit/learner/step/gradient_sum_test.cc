// Gradients of micro-batches are added in their order, element by element, however many threads and parts there are.
#include "learner/step/gradient_sum.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace gradient_sum_test {

using torch::Tensor;

struct Part {
  std::vector<Tensor> gradients;
  int64_t index = 0;
};

/// Numbers of very different sizes: their sum depends on the order.
Tensor noise(const std::vector<int64_t>& sizes, uint32_t seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<float> normal;
  Tensor values = torch::empty(sizes);
  for (int64_t k = 0; k < values.numel(); ++k)
    values.data_ptr<float>()[k] = normal(engine) * std::pow(10.0f, normal(engine));
  return values;
}

std::vector<Tensor> parameters() {
  std::vector<Tensor> all;
  for (const std::vector<int64_t>& sizes : {std::vector<int64_t>{320, 211}, {7}, {4, 5, 3, 3}, {2}})
    all.push_back(torch::zeros(sizes).set_requires_grad(true));
  return all;
}

/// The third parameter's gradients lie in memory the other way round, the last one has none, and part 1 does not reach the
/// second.
Part part_of(const std::vector<Tensor>& parameters, int64_t index) {
  Part part{.gradients = {}, .index = index};
  for (std::size_t p = 0; p < parameters.size(); ++p)
    part.gradients.push_back(noise(parameters[p].sizes().vec(), static_cast<uint32_t>(100 * index) + p));
  part.gradients[2] = part.gradients[2].contiguous(at::MemoryFormat::ChannelsLast);
  part.gradients[3] = Tensor();
  if (index == 1) part.gradients[1] = Tensor();
  return part;
}

void expect_sum_in_order(int threads, int64_t count, bool has_gradient_before) {
  const std::vector<Tensor> all = parameters();
  std::vector<Tensor> expected(all.size());
  if (has_gradient_before)
    for (std::size_t p = 0; p < all.size(); ++p) {
      all[p].mutable_grad() = noise(all[p].sizes().vec(), 7);
      expected[p] = all[p].grad().clone();
    }
  for (int64_t i = 0; i < count; ++i) {
    const Part part = part_of(all, i);
    for (std::size_t p = 0; p < all.size(); ++p) {
      if (!part.gradients[p].defined()) continue;
      expected[p] = expected[p].defined() ? expected[p] + part.gradients[p] : part.gradients[p];
    }
  }
  device::PartPool pool(threads);
  std::vector<int64_t> order;
  ASSERT_TRUE(sum_gradients<Part>(
      pool, all, count, [&](int64_t i) { return part_of(all, i); },
      [&](const Part& part) { order.push_back(part.index); }, nullptr));
  for (std::size_t p = 0; p < all.size(); ++p) {
    ASSERT_EQ(all[p].grad().defined(), expected[p].defined()) << "parameter " << p;
    if (expected[p].defined()) {
      EXPECT_TRUE(torch::equal(all[p].grad(), expected[p])) << "parameter " << p;
    }
  }
  ASSERT_EQ(order.size(), static_cast<std::size_t>(count));
  for (int64_t i = 0; i < count; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], i);
}

TEST(GradientSum, IsThatOfAPlainLoopInTheOrderOfTheParts) {
  for (const int threads : {1, 2, 5})
    for (const int64_t count : {1, 2, 3, 16, 37})
      for (const bool has_gradient_before : {false, true}) {
        SCOPED_TRACE(testing::Message() << threads << " threads, " << count << " parts");
        expect_sum_in_order(threads, count, has_gradient_before);
      }
}

TEST(GradientSum, GoesTheSameWayWhereADeviceComputes) {
  const device::OperatorPath as_on_a_device;
  expect_sum_in_order(1, 5, true);
}

TEST(GradientSum, KeepsAFewPartsAtATime) {
  const std::vector<Tensor> all = parameters();
  EXPECT_EQ(gradients_held(all, 2), 16);
  EXPECT_EQ(gradients_held(all, 24), 24);
  const device::OperatorPath as_on_a_device;
  EXPECT_EQ(gradients_held(all, 1), 1);
}

TEST(GradientSum, StopsOnRequest) {
  const std::vector<Tensor> all = parameters();
  device::PartPool pool(1);
  int64_t asked = 0, added = 0;
  EXPECT_FALSE(sum_gradients<Part>(
      pool, all, 40, [&](int64_t i) { return part_of(all, i); }, [&](const Part&) { ++added; },
      [&] { return ++asked < 3; }));
  EXPECT_EQ(added, 0) << "the first sixteen were not done";
}

}  // namespace gradient_sum_test
}  // namespace comrad::learn
