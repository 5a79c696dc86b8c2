#include "policy_workers/policy/encoder.h"

#include <algorithm>
#include <cmath>

#include "policy_workers/policy/kernels.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

constexpr double kVarianceFloor = 1e-5;
constexpr double kClip = 5.0;
constexpr int64_t kImageFeatures = 512;
constexpr int64_t kMeasurementFeatures = 128;

struct ConvShape {
  int64_t channels, kernel, stride;
};
constexpr ConvShape kConvs[3] = {{32, 8, 4}, {64, 4, 2}, {128, 3, 2}};

/// In place: the derivative is a function of the result, so nothing else needs to be kept.
Tensor activate(Tensor x) {
  at::elu_(x);
  return x;
}

}  // namespace

Tensor orthogonal(at::IntArrayRef sizes, double gain, at::Generator generator) {
  const int64_t rows = sizes[0];
  int64_t columns = 1;
  for (size_t axis = 1; axis < sizes.size(); ++axis) columns *= sizes[axis];
  // Saxe et al. 2014, arXiv:1312.6120: Q of a Gaussian matrix, signs fixed by R's diagonal so that Q is uniform.
  Tensor gaussian = torch::empty({std::max(rows, columns), std::min(rows, columns)}, torch::kFloat64);
  gaussian.normal_(0.0, 1.0, generator);
  auto [q, r] = at::linalg_qr(gaussian);
  q = q * r.diagonal().sign();
  if (rows < columns) q = q.t();
  return (q * gain).to(torch::kFloat32).contiguous().view(sizes);
}

InputNormalizer InputNormalizer::create(int64_t element_count, double scale, bool enabled, torch::Device device) {
  InputNormalizer normalizer;
  normalizer.element_count_ = element_count;
  normalizer.scale_ = scale;
  normalizer.enabled_ = enabled;
  const auto options = torch::TensorOptions(torch::kFloat64).device(device);
  normalizer.mean_ = torch::zeros({element_count}, options);
  normalizer.variance_ = torch::ones({element_count}, options);
  normalizer.count_ = torch::ones({1}, options);
  normalizer.refresh();
  return normalizer;
}

void InputNormalizer::refresh() {
  if (enabled_) {
    const Tensor sigma = (variance_ + kVarianceFloor).sqrt();
    factor_ = (1.0 / (sigma * scale_)).to(torch::kFloat32);
    offset_ = (-mean_ / sigma).to(torch::kFloat32);
  } else {
    factor_ = torch::full_like(mean_, 1.0 / scale_, torch::kFloat32);
    offset_ = torch::zeros_like(mean_, torch::kFloat32);
  }
}

Tensor InputNormalizer::normalize(const Tensor& rows) const {
  if (rows.is_cpu() && rows.scalar_type() == torch::kUInt8) {
    const Tensor dense = rows.contiguous();
    const Tensor out = torch::empty({dense.size(0), element_count_}, torch::kFloat32);
    std::vector<const uint8_t*> pointers(static_cast<size_t>(dense.size(0)));
    for (size_t row = 0; row < pointers.size(); ++row)
      pointers[row] = dense.data_ptr<uint8_t>() + static_cast<int64_t>(row) * element_count_;
    normalize_rows(pointers, out.data_ptr<float>());
    return out;
  }
  Tensor scaled = rows.to(torch::kFloat32);
  if (!enabled_) return scaled * factor_;
  return at::addcmul(offset_, scaled, factor_).clamp_(-kClip, kClip);
}

void InputNormalizer::normalize_rows(std::span<const uint8_t* const> rows, float* out) const {
  // Without statistics x / 255 lies in [0, 1], so the clip never acts.
  kernels::normalize_bytes(rows, element_count_, factor_.data_ptr<float>(), offset_.data_ptr<float>(),
                           static_cast<float>(kClip), out);
}

void InputNormalizer::update(const Tensor& rows) {
  if (!enabled_ || rows.numel() == 0) return;
  torch::NoGradGuard no_grad;
  const Tensor flat = rows.reshape({-1, element_count_});
  const double batch_count = static_cast<double>(flat.size(0));
  Tensor sum, square_sum;
  if (flat.is_cpu() && flat.scalar_type() == torch::kUInt8) {
    // Bytes are summed as integers: exact, in any order.
    const Tensor dense = flat.contiguous();
    sum = torch::empty({element_count_}, torch::kFloat64);
    square_sum = torch::empty({element_count_}, torch::kFloat64);
    kernels::sum_bytes(dense.data_ptr<uint8_t>(), dense.size(0), element_count_, sum.data_ptr<double>(),
                       square_sum.data_ptr<double>());
    sum = sum.to(mean_.device());
    square_sum = square_sum.to(mean_.device());
  } else {
    // In slices, because the double copy of a whole batch of frames would not fit beside the network on a GPU.
    sum = torch::zeros_like(mean_);
    square_sum = torch::zeros_like(mean_);
    for (int64_t first = 0; first < flat.size(0); first += 256) {
      const Tensor slice = flat.slice(0, first, first + 256).to(mean_.device()).to(torch::kFloat64);
      sum.add_(slice.sum(0));
      square_sum.add_(slice.square().sum(0));
    }
  }
  const Tensor batch_mean = sum / batch_count;
  // One row has no unbiased variance; its spread around the running mean still enters through delta below.
  const Tensor batch_spread = (square_sum - sum * batch_mean).clamp_min_(0.0);
  const Tensor batch_variance = batch_spread / std::max(batch_count - 1.0, 1.0);
  const Tensor delta = batch_mean / scale_ - mean_;
  const double old_count = count_.item<double>();
  const double total = old_count + batch_count;
  // Chan, Golub, LeVeque 1979: M2 = var_a n_a + var_b n_b + delta^2 n_a n_b / n.
  const Tensor m2 = variance_ * old_count + batch_variance * (batch_count / (scale_ * scale_)) +
                    delta.square() * (old_count * batch_count / total);
  mean_.add_(delta, batch_count / total);
  variance_.copy_(m2 / total);
  count_.fill_(total);
  refresh();
}

NamedTensors InputNormalizer::named_buffers(const std::string& prefix) const {
  if (!enabled_) return {};
  return {{prefix + ".mean", mean_}, {prefix + ".var", variance_}, {prefix + ".count", count_}};
}

Encoder Encoder::create(const EnvShape& env, double init_gain, bool normalize_input, at::Generator generator,
                        torch::Device device) {
  Encoder encoder;
  encoder.env_ = env;
  encoder.device_ = device;
  encoder.frame_normalizer_ = InputNormalizer::create(env.frame_bytes(), 255.0, normalize_input, device);
  auto make_layer = [&](at::IntArrayRef sizes) {
    return Layer{orthogonal(sizes, init_gain, generator).to(device).requires_grad_(),
                 torch::zeros({sizes[0]}).to(device).requires_grad_()};
  };
  int64_t channels = env.channels, height = env.height, width = env.width;
  for (size_t index = 0; index < 3; ++index) {
    const ConvShape& conv = kConvs[index];
    encoder.conv_[index] = make_layer({conv.channels, channels, conv.kernel, conv.kernel});
    channels = conv.channels;
    height = (height - conv.kernel) / conv.stride + 1;
    width = (width - conv.kernel) / conv.stride + 1;
    COMRAD_CHECK(height > 0 && width > 0, "frames must be large enough for convnet_simple (36 x 36 and up)");
  }
  encoder.image_ = make_layer({kImageFeatures, channels * height * width});
  if (env.measurement_count > 0) {
    encoder.measurement_normalizer_ =
        InputNormalizer::create(env.measurement_count, 1.0, normalize_input, device);
    encoder.measurement_[0] = make_layer({kMeasurementFeatures, env.measurement_count});
    encoder.measurement_[1] = make_layer({kMeasurementFeatures, kMeasurementFeatures});
  }
  return encoder;
}

Tensor Encoder::forward(const Tensor& frame, const Tensor& measurement) const {
  const int64_t rows = frame.size(0);
  const Tensor flat = frame.reshape({rows, env_.frame_bytes()}).to(device_);
  return features(frame_normalizer_.normalize(flat).view({rows, env_.channels, env_.height, env_.width}),
                  measurement);
}

Tensor Encoder::forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const {
  const int64_t rows = static_cast<int64_t>(frames.size());
  if (device_.is_cpu()) {
    const Tensor pixels = torch::empty({rows, env_.channels, env_.height, env_.width});
    frame_normalizer_.normalize_rows(frames, pixels.data_ptr<float>());
    return features(pixels, measurement);
  }
  // A quarter of the bytes crosses to the accelerator, which normalises there.
  const Tensor bytes = torch::empty({rows, env_.frame_bytes()}, torch::kUInt8);
  for (int64_t row = 0; row < rows; ++row)
    std::copy_n(frames[static_cast<size_t>(row)], env_.frame_bytes(),
                bytes.data_ptr<uint8_t>() + row * env_.frame_bytes());
  return forward(bytes, measurement);
}

Tensor Encoder::features(const Tensor& pixels, const Tensor& measurement) const {
  Tensor x = pixels;
  for (size_t index = 0; index < 3; ++index)
    x = activate(at::conv2d(x, conv_[index].weight, conv_[index].bias, kConvs[index].stride));
  x = activate(at::linear(x.flatten(1), image_.weight, image_.bias));
  if (env_.measurement_count == 0) return x;
  COMRAD_CHECK(measurement.defined() && measurement.size(-1) == env_.measurement_count,
               "this shape has a measurement vector");
  Tensor m = measurement_normalizer_.normalize(
      measurement.reshape({x.size(0), env_.measurement_count}).to(device_));
  for (const Layer& layer : measurement_) m = activate(at::linear(m, layer.weight, layer.bias));
  return at::cat({x, m}, 1);
}

void Encoder::update_statistics(const Tensor& frame, const Tensor& measurement) {
  frame_normalizer_.update(frame);
  if (env_.measurement_count > 0 && measurement.defined()) measurement_normalizer_.update(measurement);
}

void Encoder::refresh_statistics() {
  torch::NoGradGuard no_grad;
  frame_normalizer_.refresh();
  if (env_.measurement_count > 0) measurement_normalizer_.refresh();
}

int64_t Encoder::feature_count() const {
  return kImageFeatures + (env_.measurement_count > 0 ? kMeasurementFeatures : 0);
}

NamedTensors Encoder::named_parameters() const {
  NamedTensors named;
  for (size_t index = 0; index < 3; ++index) {
    const std::string name = "encoder.conv" + std::to_string(index + 1);
    named.emplace_back(name + ".weight", conv_[index].weight);
    named.emplace_back(name + ".bias", conv_[index].bias);
  }
  named.emplace_back("encoder.image.weight", image_.weight);
  named.emplace_back("encoder.image.bias", image_.bias);
  if (env_.measurement_count > 0) {
    for (size_t index = 0; index < 2; ++index) {
      const std::string name = "encoder.measurement" + std::to_string(index + 1);
      named.emplace_back(name + ".weight", measurement_[index].weight);
      named.emplace_back(name + ".bias", measurement_[index].bias);
    }
  }
  return named;
}

NamedTensors Encoder::named_buffers() const {
  NamedTensors named = frame_normalizer_.named_buffers("normalizer.frame");
  if (env_.measurement_count > 0)
    for (auto& entry : measurement_normalizer_.named_buffers("normalizer.measurement")) named.push_back(entry);
  return named;
}

}  // namespace comrad::policy
