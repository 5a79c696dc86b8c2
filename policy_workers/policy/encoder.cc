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

/// Rows that pass all layers of the pixel path together on a CPU: their activations stay in the caches on the
/// way, and memory grows with the rows only by what the backward pass needs.
constexpr int64_t kChunkRows = 64;

/// Rows [B, elements] of u8 on the CPU to f32: clamp(x * factor + offset).
Tensor normalize_bytes(const Tensor& rows, const Tensor& factor, const Tensor& offset) {
  const Tensor dense = rows.contiguous();
  const int64_t element_count = factor.numel();
  const Tensor out = torch::empty({dense.size(0), element_count}, torch::kFloat32);
  std::vector<const uint8_t*> pointers(static_cast<size_t>(dense.size(0)));
  for (size_t row = 0; row < pointers.size(); ++row)
    pointers[row] = dense.data_ptr<uint8_t>() + static_cast<int64_t>(row) * element_count;
  kernels::normalize_bytes(pointers, element_count, factor.data_ptr<float>(), offset.data_ptr<float>(),
                           static_cast<float>(kClip), out.data_ptr<float>());
  return out;
}

/// ELU in place; x is ours alone.
void elu_in_place(Tensor& x) {
  if (x.is_cpu() && x.is_contiguous())
    kernels::elu(x.data_ptr<float>(), x.numel());
  else
    at::elu_(x);
}

/// Turns the gradient of an ELU's result y into the gradient of its input.
Tensor elu_gradient(Tensor grad, const Tensor& y) {
  grad = grad.contiguous();
  kernels::elu_backward(y.data_ptr<float>(), grad.data_ptr<float>(), grad.numel());
  return grad;
}

/// ELU(x W^T + b) with autograd; in place, as the derivative is a function of the result.
Tensor dense_elu(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  Tensor y = at::linear(x, weight, bias);
  at::elu_(y);
  return y;
}

/// The three convolutions on a CPU, in chunks, normalisation included: bytes [B, C, H, W] to features [B,
/// 2304].
///
/// Autograd's own graph would hold the normalised pixels of the whole batch and pass every layer over the
/// whole batch; this one keeps three activations per chunk and normalises the pixels a second time on the way
/// back.
struct PixelPath : torch::autograd::Function<PixelPath> {
  using Context = torch::autograd::AutogradContext;
  using TensorList = torch::autograd::tensor_list;

  static Tensor forward(Context* context, const Tensor& frame, const Tensor& factor, const Tensor& offset,
                        const Tensor& w1, const Tensor& b1, const Tensor& w2, const Tensor& b2,
                        const Tensor& w3, const Tensor& b3) {
    const Tensor weights[] = {w1, w2, w3}, biases[] = {b1, b2, b3};
    TensorList saved = {w1, w2, w3, frame, factor, offset}, outputs;
    for (int64_t first = 0; first < frame.size(0); first += kChunkRows) {
      const Tensor chunk = frame.slice(0, first, first + kChunkRows);
      Tensor x = normalize_bytes(chunk.flatten(1), factor, offset).view_as(chunk);
      for (size_t layer = 0; layer < 3; ++layer) {
        x = at::conv2d(x, weights[layer], biases[layer], kConvs[layer].stride).contiguous();
        elu_in_place(x);
        saved.push_back(x);
      }
      outputs.push_back(x.flatten(1));
    }
    context->save_for_backward(saved);
    return at::cat(outputs);
  }

  static TensorList backward(Context* context, TensorList grad_outputs) {
    const TensorList saved = context->get_saved_variables();
    const Tensor &frame = saved[3], &factor = saved[4], &offset = saved[5];
    Tensor weight_gradient[3], bias_gradient[3];
    size_t next = 6;
    for (int64_t first = 0; first < frame.size(0); first += kChunkRows, next += 3) {
      const Tensor chunk = frame.slice(0, first, first + kChunkRows);
      // A copy: autograd may hand the same gradient to others.
      Tensor grad = grad_outputs[0].slice(0, first, first + kChunkRows).clone().view_as(saved[next + 2]);
      for (size_t layer = 3; layer-- > 0;) {
        const Tensor x = layer > 0 ? saved[next + layer - 1]
                                   : normalize_bytes(chunk.flatten(1), factor, offset).view_as(chunk);
        grad = elu_gradient(grad, saved[next + layer]);
        const int64_t stride = kConvs[layer].stride;
        auto [to_input, to_weight, to_bias] = at::convolution_backward(
            grad, x, saved[layer], at::OptionalIntArrayRef({kConvs[layer].channels}), {stride, stride},
            {0, 0}, {1, 1}, false, {0, 0}, 1, {layer > 0, true, true});
        if (first == 0) {
          weight_gradient[layer] = to_weight;
          bias_gradient[layer] = to_bias;
        } else {
          weight_gradient[layer].add_(to_weight);
          bias_gradient[layer].add_(to_bias);
        }
        grad = to_input;
      }
    }
    return {Tensor(),           Tensor(),         Tensor(),           weight_gradient[0], bias_gradient[0],
            weight_gradient[1], bias_gradient[1], weight_gradient[2], bias_gradient[2]};
  }
};

}  // namespace

Tensor orthogonal(at::IntArrayRef sizes, double gain, at::Generator generator) {
  const int64_t rows = sizes[0];
  int64_t columns = 1;
  for (size_t axis = 1; axis < sizes.size(); ++axis) columns *= sizes[axis];
  // Saxe et al. 2014, arXiv:1312.6120: Q of a Gaussian matrix, signs fixed by R's diagonal so that Q is
  // uniform.
  Tensor gaussian = torch::empty({std::max(rows, columns), std::min(rows, columns)}, torch::kFloat64);
  gaussian.normal_(0.0, 1.0, generator);
  auto [q, r] = at::linalg_qr(gaussian);
  q = q * r.diagonal().sign();
  if (rows < columns) q = q.t();
  return (q * gain).to(torch::kFloat32).contiguous().view(sizes);
}

InputNormalizer InputNormalizer::create(int64_t element_count, double scale, bool enabled,
                                        torch::Device device) {
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
  if (rows.is_cpu() && rows.scalar_type() == torch::kUInt8) return normalize_bytes(rows, factor_, offset_);
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
    // In slices, because the double copy of a whole batch of frames would not fit beside the network on a
    // GPU.
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
  const Tensor bytes =
      frame.reshape({frame.size(0), env_.channels, env_.height, env_.width}).to(device_).contiguous();
  if (device_.is_cpu())
    return features(
        PixelPath::apply(bytes, frame_normalizer_.factor(), frame_normalizer_.offset(), conv_[0].weight,
                         conv_[0].bias, conv_[1].weight, conv_[1].bias, conv_[2].weight, conv_[2].bias),
        measurement);
  return features(convolve(frame_normalizer_.normalize(bytes.flatten(1)).view_as(bytes)), measurement);
}

Tensor Encoder::forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const {
  const int64_t rows = static_cast<int64_t>(frames.size());
  if (!device_.is_cpu()) {
    // A quarter of the bytes crosses to the accelerator, which normalises there.
    const Tensor bytes = torch::empty({rows, env_.channels, env_.height, env_.width}, torch::kUInt8);
    for (int64_t row = 0; row < rows; ++row)
      std::copy_n(frames[static_cast<size_t>(row)], env_.frame_bytes(),
                  bytes.data_ptr<uint8_t>() + row * env_.frame_bytes());
    return forward(bytes, measurement);
  }
  torch::NoGradGuard no_grad;
  std::vector<Tensor> maps;
  for (int64_t first = 0; first < rows; first += kChunkRows) {
    const int64_t count = std::min(kChunkRows, rows - first);
    const Tensor pixels = torch::empty({count, env_.channels, env_.height, env_.width});
    frame_normalizer_.normalize_rows(frames.subspan(static_cast<size_t>(first), static_cast<size_t>(count)),
                                     pixels.data_ptr<float>());
    maps.push_back(convolve(pixels));
  }
  return features(maps.size() == 1 ? maps.front() : at::cat(maps), measurement);
}

/// The convolutions as plain operators: for accelerators, and for passes without a gradient.
Tensor Encoder::convolve(Tensor x) const {
  for (size_t index = 0; index < 3; ++index) {
    x = at::conv2d(x, conv_[index].weight, conv_[index].bias, kConvs[index].stride);
    if (device_.is_cpu() && !at::GradMode::is_enabled())
      elu_in_place(x);
    else
      at::elu_(x);
  }
  return x.flatten(1);
}

Tensor Encoder::features(const Tensor& map, const Tensor& measurement) const {
  const Tensor x = dense_elu(map, image_.weight, image_.bias);
  if (env_.measurement_count == 0) return x;
  COMRAD_CHECK(measurement.defined() && measurement.size(-1) == env_.measurement_count,
               "this shape has a measurement vector");
  Tensor m =
      measurement_normalizer_.normalize(measurement.reshape({x.size(0), env_.measurement_count}).to(device_));
  for (const Layer& layer : measurement_) m = dense_elu(m, layer.weight, layer.bias);
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
    for (auto& entry : measurement_normalizer_.named_buffers("normalizer.measurement"))
      named.push_back(entry);
  return named;
}

}  // namespace comrad::policy
