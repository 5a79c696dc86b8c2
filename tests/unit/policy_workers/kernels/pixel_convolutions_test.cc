#include "policy_workers/kernels/pixel_convolutions.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/precision.h"

namespace comrad::policy {
namespace pixel_convolutions_test {

using torch::Tensor;

constexpr float kClip = 2.0f;

/// Two layers whose channels fill no vector, and a third. A first one of stride 4 leaves pixels over at two edges.
struct Layers {
  explicit Layers(int64_t stride)
      : weights({torch::randn({24, 3, 2 * stride, 2 * stride}) / 12, torch::randn({7, 24, 4, 4}) / 20,
                 torch::randn({32, 7, 3, 3}) / 8}),
        biases({torch::randn({24}), torch::randn({7}), torch::randn({32})}),
        strides({stride, 2, 1}) {}
  std::vector<Tensor> weights, biases;
  std::vector<int64_t> strides;
};

class Convolutions : public ::testing::TestWithParam<std::tuple<Precision, int64_t>> {
 protected:
  static Precision precision() { return std::get<0>(GetParam()); }
  /// As a factor of a product, in f64.
  static Tensor factor(const Tensor& x) {
    return (precision() == Precision::kBf16 ? x.to(torch::kBFloat16) : x).to(torch::kFloat64);
  }
  static double tolerance() { return precision() == Precision::kBf16 ? 2e-2 : 2e-5; }
  static Layers seeded() {
    torch::manual_seed(6);
    return Layers(std::get<1>(GetParam()));
  }

  PixelConvolutions& stack_for(const Tensor& frames) const {
    return PixelConvolutions::of(frames.sizes(), layers_.weights, layers_.strides, precision());
  }
  /// Activations of frames, their pixels first.
  std::vector<Tensor> forward(PixelConvolutions& stack, const Tensor& frames) const {
    std::vector<const uint8_t*> rows;
    for (int64_t row = 0; row < frames.size(0); ++row) rows.push_back(frames[row].data_ptr<uint8_t>());
    std::vector<Tensor> all = {stack.pixels(rows, factor_, offset_, kClip)};
    for (std::size_t layer = 0; layer < 3; ++layer)
      all.push_back(stack.forward(layer, all.back(), layers_.weights[layer], layers_.biases[layer]));
    return all;
  }
  Tensor features(const Tensor& frames) const {
    PixelConvolutions& stack = stack_for(frames);
    return stack.to_features(forward(stack, frames).back());
  }

  Layers layers_ = seeded();
  Tensor frames_ = torch::randint(0, 256, {9, 3, 38, 45}, torch::kUInt8);
  Tensor factor_ = torch::rand({3 * 38 * 45}) / 50, offset_ = torch::randn({3 * 38 * 45});
};

TEST_P(Convolutions, EqualTheLayersWrittenOutForwardAndBack) {
  std::vector<Tensor> p;
  for (std::size_t layer = 0; layer < 3; ++layer) {
    p.push_back(factor(layers_.weights[layer]).requires_grad_());
    p.push_back(layers_.biases[layer].to(torch::kFloat64).requires_grad_());
  }
  const Tensor scaled = frames_.flatten(1).to(torch::kFloat32) * factor_ + offset_;
  Tensor x = factor(scaled.clamp(-kClip, kClip)).view(frames_.sizes());
  for (std::size_t layer = 0; layer < 3; ++layer)
    x = at::elu(at::conv2d(x, p[2 * layer], p[2 * layer + 1], layers_.strides[layer]));
  const Tensor expected = x.flatten(1), towards = factor(torch::randn_like(expected));
  (expected * towards).sum().backward();

  torch::NoGradGuard no_grad;
  PixelConvolutions& stack = stack_for(frames_);
  const std::vector<Tensor> all = forward(stack, frames_);
  const Tensor ours_forward = stack.to_features(all[3]);
  EXPECT_EQ(ours_forward.scalar_type(), stack.type());
  EXPECT_LT((ours_forward.to(torch::kFloat64) - expected).abs().max().item<double>(),
            tolerance() * expected.abs().max().item<double>());
  Tensor grad = stack.from_features(towards.to(torch::kFloat32));
  for (std::size_t layer = 3; layer-- > 0;) {
    const auto gradients = stack.backward(layer, all[layer], all[layer + 1], grad, layers_.weights[layer]);
    for (const auto& [ours, reference] : {std::pair{gradients.weight, p[2 * layer].grad()},
                                          std::pair{gradients.bias, p[2 * layer + 1].grad()}}) {
      ASSERT_EQ(ours.sizes(), reference.sizes());
      EXPECT_LT((ours.to(torch::kFloat64) - reference).norm().item<double>(),
                tolerance() * reference.norm().item<double>())
          << "layer " << layer;
    }
    EXPECT_EQ(gradients.x.defined(), layer > 0);
    grad = gradients.x;
  }
}

TEST_P(Convolutions, SeeEveryNewVersionOfAWeight) {
  torch::NoGradGuard no_grad;
  const Tensor before = features(frames_);
  for (const std::size_t layer : {0, 1}) {
    layers_.weights[layer].mul_(2);
    EXPECT_FALSE(torch::equal(features(frames_), before));
    layers_.weights[layer].mul_(0.5);
    EXPECT_TRUE(torch::equal(features(frames_), before));
  }
}

TEST_P(Convolutions, KeepWhatIsNotFinite) {
  torch::NoGradGuard no_grad;
  layers_.weights[0][3] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(features(frames_).isfinite().any().item<bool>());
}

TEST_P(Convolutions, GiveARowTheSameFeaturesAmongOthers) {
  torch::NoGradGuard no_grad;
  EXPECT_TRUE(torch::equal(features(frames_.slice(0, 4, 5)), features(frames_).slice(0, 4, 5)));
}

std::string name_of(const ::testing::TestParamInfo<std::tuple<Precision, int64_t>>& info) {
  const auto [precision, stride] = info.param;
  return (precision == Precision::kFp32 ? "fp32_" : "bf16_") + std::to_string(stride);
}

INSTANTIATE_TEST_SUITE_P(PrecisionsAndStrides, Convolutions,
                         ::testing::Combine(::testing::Values(Precision::kFp32, Precision::kBf16),
                                            ::testing::Values(3, 4)),
                         name_of);

}  // namespace pixel_convolutions_test
}  // namespace comrad::policy
