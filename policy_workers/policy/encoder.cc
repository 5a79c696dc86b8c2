#include "policy_workers/policy/encoder.h"

#include <algorithm>
#include <cmath>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/share_out.h"
#include "policy_workers/policy/kernels.h"
#include "policy_workers/policy/pixel_convolutions.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"

namespace comrad::policy {
namespace {

constexpr double kVarianceFloor = 1e-5;
constexpr float kClip = 5.0f;
constexpr int64_t kImageFeatures = 512;
constexpr int64_t kMeasurementFeatures = 128;

/// The plain convolution stacks; resnet_impala has a form of its own.
std::vector<ConvStack>& conv_stacks() {
  static std::vector<ConvStack> stacks = {
      {"convnet_simple", {{32, 8, 4}, {64, 4, 2}, {128, 3, 2}}},
      {"convnet_impala", {{16, 8, 4}, {32, 4, 2}}},
      {"convnet_atari", {{32, 8, 4}, {64, 4, 2}, {64, 3, 1}}},
  };
  return stacks;
}
constexpr const char* kResnetName = "resnet_impala";
constexpr int64_t kResnetChannels[] = {16, 32, 32};
constexpr int64_t kResidualBlocks = 2;  // per stage, two convolutions each
constexpr size_t kConvsPerStage = 1 + 2 * kResidualBlocks;

/// Rows that pass all layers of the pixel path together on a CPU: their activations stay in the caches on the
/// way, and memory grows with the rows only by what the backward pass needs.
constexpr int64_t kChunkRows = 64;
/// The same for resnet_impala, whose first stage works at the frame's full size.
constexpr int64_t kResnetChunkRows = 32;
/// Columns of the frames' statistics that one thread adds up at a time.
constexpr int64_t kColumnsOfAPiece = 2048;

std::vector<const uint8_t*> rows_of(const Tensor& dense) {
  std::vector<const uint8_t*> rows(static_cast<size_t>(dense.size(0)));
  for (size_t row = 0; row < rows.size(); ++row)
    rows[row] = dense.data_ptr<uint8_t>() + static_cast<int64_t>(row) * dense.stride(0);
  return rows;
}

/// Rows [B, elements] of u8 on the CPU to f32: clamp(x * factor + offset).
Tensor normalize_bytes(const Tensor& rows, const Tensor& factor, const Tensor& offset) {
  const Tensor dense = rows.contiguous();
  const Tensor out = torch::empty({dense.size(0), factor.numel()}, torch::kFloat32);
  kernels::normalize_bytes(rows_of(dense), factor.numel(), factor.data_ptr<float>(), offset.data_ptr<float>(),
                           kClip, out.data_ptr<float>());
  return out;
}

/// ELU(x W^T + b) with autograd; in place, as the derivative is a function of the result.
Tensor dense_elu(const Tensor& x, const Tensor& weight, const Tensor& bias, Precision precision) {
  Tensor y = linear(x, weight, bias, precision);
  at::elu_(y);
  return y;
}

/// A convolution with its bias; the product in the given precision, the result f32.
Tensor convolve(const Tensor& x, const Tensor& weight, const Tensor& bias, int64_t stride, int64_t padding,
                Precision precision) {
  if (precision == Precision::kFp32) return at::conv2d(x, weight, bias, stride, padding);
  const Tensor product =
      at::conv2d(factor(x, precision), factor(weight, precision), Tensor(), stride, padding);
  return to_f32(product) + bias.view({1, -1, 1, 1});
}

/// A stack of two or three convolutions on a CPU, in chunks, normalisation included: bytes [B, C, H, W] to
/// features [B, K], which are bfloat16 where products are. Of two layers the third has empty tensors.
///
/// Autograd's own graph would hold the normalised pixels of the whole batch and pass every layer over the
/// whole batch; this one keeps three activations per chunk and normalises the pixels a second time on the
/// way back.
struct PixelPath : torch::autograd::Function<PixelPath> {
  using Context = torch::autograd::AutogradContext;
  using TensorList = torch::autograd::tensor_list;

  static Tensor forward(Context* context, const Tensor& frame, const Tensor& factor, const Tensor& offset,
                        const Tensor& w1, const Tensor& b1, const Tensor& w2, const Tensor& b2,
                        const Tensor& w3, const Tensor& b3, const std::vector<int64_t>& strides,
                        Precision precision) {
    const Tensor weights[] = {w1, w2, w3}, biases[] = {b1, b2, b3};
    TensorList saved = {w1, w2, w3, frame, factor, offset}, outputs;
    for (int64_t first = 0; first < frame.size(0); first += kChunkRows) {
      const Tensor chunk = frame.slice(0, first, first + kChunkRows);
      PixelConvolutions& stack = PixelConvolutions::of(chunk.sizes(), weights, strides, precision);
      Tensor x = stack.pixels(rows_of(chunk), factor, offset, kClip);
      for (size_t layer = 0; layer < strides.size(); ++layer)
        saved.push_back(x = stack.forward(layer, x, weights[layer], biases[layer]));
      outputs.push_back(stack.to_features(x));
    }
    context->save_for_backward(saved);
    context->saved_data["strides"] = strides;
    context->saved_data["precision"] = static_cast<int64_t>(precision);
    return at::cat(outputs);
  }

  static TensorList backward(Context* context, TensorList grad_outputs) {
    const std::vector<int64_t> strides = context->saved_data["strides"].toIntVector();
    const auto precision = static_cast<Precision>(context->saved_data["precision"].toInt());
    const size_t layers = strides.size();
    const TensorList saved = context->get_saved_variables();
    const Tensor &frame = saved[3], &factor = saved[4], &offset = saved[5];
    Tensor weight_gradient[3], bias_gradient[3];
    size_t next = 6;
    for (int64_t first = 0; first < frame.size(0); first += kChunkRows, next += layers) {
      const Tensor chunk = frame.slice(0, first, first + kChunkRows);
      PixelConvolutions& stack = PixelConvolutions::of(chunk.sizes(), saved, strides, precision);
      Tensor grad = stack.from_features(grad_outputs[0].slice(0, first, first + kChunkRows));
      for (size_t layer = layers; layer-- > 0;) {
        const Tensor x =
            layer > 0 ? saved[next + layer - 1] : stack.pixels(rows_of(chunk), factor, offset, kClip);
        auto gradients = stack.backward(layer, x, saved[next + layer], grad, saved[layer]);
        if (first == 0) {
          weight_gradient[layer] = gradients.weight;
          bias_gradient[layer] = gradients.bias;
        } else {
          weight_gradient[layer].add_(gradients.weight);
          bias_gradient[layer].add_(gradients.bias);
        }
        grad = gradients.x;
      }
    }
    return {Tensor(),         Tensor(),           Tensor(),         weight_gradient[0],
            bias_gradient[0], weight_gradient[1], bias_gradient[1], weight_gradient[2],
            bias_gradient[2], Tensor(),           Tensor()};
  }
};

/// The convolutions of resnet_impala on normalised pixels: per stage a convolution and a pooling that
/// halves the picture, then residual blocks x + conv(elu(conv(elu(x)))); ELU at the end. Plain operators
/// with autograd.
Tensor resnet_maps(Tensor x, const std::vector<Tensor>& weights, const std::vector<Tensor>& biases,
                   Precision precision) {
  for (size_t index = 0; index < weights.size();) {
    x = convolve(x, weights[index], biases[index], 1, 1, precision);
    x = at::max_pool2d(x, 3, 2, 1);
    ++index;
    for (int64_t block = 0; block < kResidualBlocks; ++block, index += 2) {
      Tensor inner = convolve(at::elu(x), weights[index], biases[index], 1, 1, precision);
      at::elu_(inner);
      x = x + convolve(inner, weights[index + 1], biases[index + 1], 1, 1, precision);
    }
  }
  return at::elu(x).flatten(1);
}

/// resnet_impala on a CPU, in chunks that are computed a second time on the way back: its activations take 2
/// MB a frame, so a graph over a whole micro-batch would not fit beside the rest of a small machine's work.
/// All weights and biases come in one flat tensor, because a custom function takes a fixed number of them.
struct ResnetPath : torch::autograd::Function<ResnetPath> {
  using Context = torch::autograd::AutogradContext;
  using TensorList = torch::autograd::tensor_list;

  static Tensor maps(const Tensor& chunk, const Tensor& factor, const Tensor& offset, const Tensor& packed,
                     Precision precision) {
    std::vector<Tensor> weights, biases;
    int64_t next = 0, inputs = chunk.size(1);
    for (const int64_t channels : kResnetChannels)
      for (size_t conv = 0; conv < kConvsPerStage; ++conv) {
        const int64_t count = channels * inputs * 9;
        weights.push_back(packed.slice(0, next, next + count).view({channels, inputs, 3, 3}));
        biases.push_back(packed.slice(0, next + count, next + count + channels));
        next += count + channels;
        inputs = channels;
      }
    return resnet_maps(normalize_bytes(chunk.flatten(1), factor, offset).view_as(chunk), weights, biases,
                       precision);
  }

  static Tensor forward(Context* context, const Tensor& frame, const Tensor& factor, const Tensor& offset,
                        const Tensor& packed, Precision precision) {
    TensorList outputs;
    for (int64_t first = 0; first < frame.size(0); first += kResnetChunkRows)
      outputs.push_back(
          maps(frame.slice(0, first, first + kResnetChunkRows), factor, offset, packed, precision));
    context->save_for_backward({frame, factor, offset, packed});
    context->saved_data["precision"] = static_cast<int64_t>(precision);
    return at::cat(outputs);
  }

  static TensorList backward(Context* context, TensorList grad_outputs) {
    const TensorList saved = context->get_saved_variables();
    const auto precision = static_cast<Precision>(context->saved_data["precision"].toInt());
    torch::AutoGradMode with_gradient(true);
    const Tensor packed = saved[3].detach().requires_grad_();
    for (int64_t first = 0; first < saved[0].size(0); first += kResnetChunkRows) {
      const Tensor output =
          maps(saved[0].slice(0, first, first + kResnetChunkRows), saved[1], saved[2], packed, precision);
      output.backward(grad_outputs[0].slice(0, first, first + kResnetChunkRows));
    }
    return {Tensor(), Tensor(), Tensor(), packed.grad().detach(), Tensor()};
  }
};

}  // namespace

std::pair<Tensor, Tensor> initial_layer(at::IntArrayRef sizes, Initialization init, double gain,
                                        at::Generator generator) {
  if (init == Initialization::kZero) return {torch::zeros(sizes), torch::zeros({sizes[0]})};
  if (init == Initialization::kOrthogonal)
    return {orthogonal(sizes, gain, generator), torch::zeros({sizes[0]})};
  int64_t inputs = 1;
  for (const int64_t size : sizes.slice(1)) inputs *= size;
  const double bound = 1.0 / std::sqrt(static_cast<double>(inputs));
  const Tensor weight = torch::empty(sizes).uniform_(-bound, bound, generator);
  return {weight, torch::empty({sizes[0]}).uniform_(-bound, bound, generator)};
}

Tensor orthogonal(at::IntArrayRef sizes, double gain, at::Generator generator) {
  const int64_t rows = sizes[0];
  int64_t columns = 1;
  for (size_t axis = 1; axis < sizes.size(); ++axis) columns *= sizes[axis];
  // Saxe et al. 2014, arXiv:1312.6120: Q of a Gaussian matrix, signs fixed by R's diagonal so that Q
  // is uniform.
  Tensor gaussian = torch::empty({std::max(rows, columns), std::min(rows, columns)}, torch::kFloat64);
  gaussian.normal_(0.0, 1.0, generator);
  // LAPACK takes a column at a time: threads would wait for each other tens of thousands of times, and round differently.
  const device::OneMathThread one_thread;
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
  normalizer.device_ = device;
  const auto options = torch::TensorOptions(torch::kFloat64).device(device);
  normalizer.mean_ = torch::zeros({element_count}, options);
  normalizer.variance_ = torch::ones({element_count}, options);
  normalizer.count_ = torch::ones({1}, options);
  normalizer.derive();
  return normalizer;
}

void InputNormalizer::refresh() {
  rows_seen_.reset();  // a policy worker, which never updates, need not wait for it
  derive();
}

void InputNormalizer::derive() {
  if (element_count_ == 0) return;
  Tensor factor, offset;
  if (enabled_) {
    const Tensor sigma = (variance_ + kVarianceFloor).sqrt();
    factor = (1.0 / (sigma * scale_)).to(torch::kFloat32);
    offset = (-mean_ / sigma).to(torch::kFloat32);
  } else {
    factor = torch::full_like(mean_, 1.0 / scale_, torch::kFloat32);
    offset = torch::zeros_like(mean_, torch::kFloat32);
  }
  if (mean_.is_cpu() || !factor_.defined()) {
    factor_ = factor;
    offset_ = offset;
  } else {  // recorded work (device/queue.h) reads them where they are
    factor_.copy_(factor);
    offset_.copy_(offset);
  }
}

Tensor InputNormalizer::normalize(const Tensor& rows) const {
  if (device::has_own_kernels(rows.device()) && rows.scalar_type() == torch::kUInt8)
    return normalize_bytes(rows, factor_, offset_);
  Tensor scaled = rows.to(torch::kFloat32);
  if (!enabled_) return scaled * factor_;
  return at::addcmul(offset_, scaled, factor_).clamp_(-kClip, kClip);
}

void InputNormalizer::normalize_rows(std::span<const uint8_t* const> rows, float* out) const {
  // Without statistics x / 255 lies in [0, 1], so the clip never acts.
  kernels::normalize_bytes(rows, element_count_, factor_.data_ptr<float>(), offset_.data_ptr<float>(), kClip,
                           out);
}

void InputNormalizer::update(const Tensor& rows, const AddUp& add_up) {
  if (!enabled_ || (rows.numel() == 0 && !add_up)) return;
  torch::NoGradGuard no_grad;
  const Tensor flat = rows.reshape({-1, element_count_});
  double batch_count = static_cast<double>(flat.size(0));
  Tensor sum, square_sum;
  if (device::has_own_kernels(flat.device()) && flat.scalar_type() == torch::kUInt8) {
    // Bytes are summed as integers: exact, in any order.
    const Tensor dense = flat.contiguous();
    sum = torch::empty({element_count_}, torch::kFloat64);
    square_sum = torch::empty({element_count_}, torch::kFloat64);
    const int64_t pieces = (element_count_ + kColumnsOfAPiece - 1) / kColumnsOfAPiece;
    device::share_out(static_cast<std::size_t>(pieces), [&](std::size_t piece) {
      const int64_t first = static_cast<int64_t>(piece) * kColumnsOfAPiece;
      kernels::sum_bytes(dense.data_ptr<uint8_t>(), dense.size(0), element_count_, first,
                         std::min(first + kColumnsOfAPiece, element_count_), sum.data_ptr<double>(),
                         square_sum.data_ptr<double>());
    });
    sum = sum.to(device_);
    square_sum = square_sum.to(device_);
  } else {
    // In slices, because the double copy of a whole batch of frames would not fit beside the network on
    // a GPU.
    sum = torch::zeros_like(mean_);
    square_sum = torch::zeros_like(mean_);
    for (int64_t first = 0; first < flat.size(0); first += 256) {
      const Tensor slice = flat.slice(0, first, first + 256).to(device_).to(torch::kFloat64);
      sum.add_(slice.sum(0));
      square_sum.add_(slice.square().sum(0));
    }
  }
  if (add_up) {
    Tensor sums = at::cat({sum, square_sum, torch::full({1}, batch_count, sum.options())});
    add_up(sums);
    sum = sums.narrow(0, 0, element_count_);
    square_sum = sums.narrow(0, element_count_, element_count_);
    batch_count = sums[2 * element_count_].item<double>();
    if (batch_count == 0) return;
  }
  const Tensor batch_mean = sum / batch_count;
  // One row has no unbiased variance; its spread around the running mean still enters through delta below.
  const Tensor batch_spread = (square_sum - sum * batch_mean).clamp_min_(0.0);
  const Tensor batch_variance = batch_spread / std::max(batch_count - 1.0, 1.0);
  const Tensor delta = batch_mean / scale_ - mean_;
  const double old_count = rows_seen_ ? *rows_seen_ : count_.item<double>();
  const double total = old_count + batch_count;
  // Chan, Golub, LeVeque 1979: M2 = var_a n_a + var_b n_b + delta^2 n_a n_b / n.
  const Tensor m2 = variance_ * old_count + batch_variance * (batch_count / (scale_ * scale_)) +
                    delta.square() * (old_count * batch_count / total);
  mean_.add_(delta, batch_count / total);
  variance_.copy_(m2 / total);
  count_.fill_(total);
  rows_seen_ = total;
  derive();
}

NamedTensors InputNormalizer::named_buffers(const std::string& prefix) const {
  if (!enabled_) return {};
  return {{prefix + ".mean", mean_}, {prefix + ".var", variance_}, {prefix + ".count", count_}};
}

std::shared_ptr<ObservationNormalizer> ObservationNormalizer::create(const EnvShape& env, bool enabled,
                                                                     torch::Device device,
                                                                     int64_t global_state_count) {
  auto normalizer = std::make_shared<ObservationNormalizer>();
  normalizer->frame = InputNormalizer::create(env.frame_bytes(), 255.0, enabled, device);
  if (env.measurement_count > 0)
    normalizer->measurement = InputNormalizer::create(env.measurement_count, 1.0, enabled, device);
  if (global_state_count > 0)
    normalizer->global_state = InputNormalizer::create(global_state_count, 1.0, /*enabled=*/true, device);
  return normalizer;
}

void ObservationNormalizer::refresh() {
  torch::NoGradGuard no_grad;
  frame.refresh();
  measurement.refresh();
  global_state.refresh();
}

NamedTensors ObservationNormalizer::named_buffers() const {
  NamedTensors named = frame.named_buffers("normalizer.frame");
  for (auto& entry : measurement.named_buffers("normalizer.measurement")) named.push_back(entry);
  for (auto& entry : global_state.named_buffers("normalizer.global_state")) named.push_back(entry);
  return named;
}

void add_encoder(ConvStack stack) {
  COMRAD_CHECK(!check_encoder(stack.name).has_value(), "an encoder's name must be new");
  conv_stacks().push_back(std::move(stack));
}

std::vector<std::string> encoder_names() {
  std::vector<std::string> names;
  for (const ConvStack& stack : conv_stacks()) names.push_back(stack.name);
  names.emplace_back(kResnetName);
  return names;
}

Status check_encoder(const std::string& name) {
  const std::vector<std::string> known = encoder_names();
  if (std::ranges::find(known, name) != known.end()) return {};
  return Error{ErrorCode::kBadInput,
               "encoder_conv_architecture is " + name + "; it must be one of " + joined(known)};
}

Encoder Encoder::create(const EncoderOptions& options, at::Generator generator, torch::Device device,
                        std::shared_ptr<ObservationNormalizer> normalizer) {
  const EnvShape& env = options.env;
  Encoder encoder;
  encoder.env_ = env;
  encoder.device_ = device;
  encoder.precision_ = options.precision;
  encoder.normalizer_ = normalizer ? std::move(normalizer)
                                   : ObservationNormalizer::create(env, options.normalize_input, device);
  auto make_layer = [&](std::string name, at::IntArrayRef sizes) {
    const auto [weight, bias] = initial_layer(sizes, options.init, options.init_gain, generator);
    return Layer{std::move(name), weight.to(device).requires_grad_(), bias.to(device).requires_grad_()};
  };
  int64_t channels = env.channels, height = env.height, width = env.width;
  const auto stack = std::ranges::find(conv_stacks(), options.architecture, &ConvStack::name);
  if (stack != conv_stacks().end()) {
    for (const ConvShape& conv : stack->convs) {
      encoder.conv_.push_back(make_layer("conv" + std::to_string(encoder.conv_.size() + 1),
                                         {conv.channels, channels, conv.kernel, conv.kernel}));
      encoder.strides_.push_back(conv.stride);
      channels = conv.channels;
      height = (height - conv.kernel) / conv.stride + 1;
      width = (width - conv.kernel) / conv.stride + 1;
      COMRAD_CHECK(height > 0 && width > 0, "frames must be large enough for the encoder (36 x 36 and up)");
    }
  } else {
    COMRAD_CHECK(check_encoder(options.architecture).has_value(), "the encoder was checked: it is known");
    encoder.is_resnet_ = true;
    for (const int64_t stage_channels : kResnetChannels)
      for (size_t conv = 0; conv < kConvsPerStage; ++conv) {
        encoder.conv_.push_back(
            make_layer("conv" + std::to_string(encoder.conv_.size() + 1), {stage_channels, channels, 3, 3}));
        channels = stage_channels;
        if (conv == 0) height = (height - 1) / 2 + 1, width = (width - 1) / 2 + 1;
      }
  }
  encoder.image_ = make_layer("image", {kImageFeatures, channels * height * width});
  if (env.measurement_count > 0) {
    encoder.measurement_.push_back(make_layer("measurement1", {kMeasurementFeatures, env.measurement_count}));
    encoder.measurement_.push_back(make_layer("measurement2", {kMeasurementFeatures, kMeasurementFeatures}));
  }
  return encoder;
}

Tensor Encoder::forward(const Tensor& frame, const Tensor& measurement) const {
  const Tensor bytes =
      frame.reshape({frame.size(0), env_.channels, env_.height, env_.width}).to(device_).contiguous();
  const InputNormalizer& normalizer = normalizer_->frame;
  if (!device::has_own_kernels(device_))
    return features(convolutions(normalizer.normalize(bytes.flatten(1)).view_as(bytes)), measurement);
  if (is_resnet_) {
    std::vector<Tensor> flat;
    for (const Layer& conv : conv_) {
      flat.push_back(conv.weight.flatten());
      flat.push_back(conv.bias);
    }
    return features(
        ResnetPath::apply(bytes, normalizer.factor(), normalizer.offset(), at::cat(flat), precision_),
        measurement);
  }
  const Tensor none = torch::empty({0});
  const bool has_third = conv_.size() > 2;
  return features(
      PixelPath::apply(bytes, normalizer.factor(), normalizer.offset(), conv_[0].weight, conv_[0].bias,
                       conv_[1].weight, conv_[1].bias, has_third ? conv_[2].weight : none,
                       has_third ? conv_[2].bias : none, strides_, precision_),
      measurement);
}

Tensor Encoder::forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const {
  const int64_t rows = static_cast<int64_t>(frames.size());
  if (!device::has_own_kernels(device_)) {
    // A quarter of the bytes crosses to the accelerator, which normalises there.
    const Tensor bytes = torch::empty({rows, env_.channels, env_.height, env_.width}, torch::kUInt8);
    for (int64_t row = 0; row < rows; ++row)
      std::copy_n(frames[static_cast<size_t>(row)], env_.frame_bytes(),
                  bytes.data_ptr<uint8_t>() + row * env_.frame_bytes());
    return forward(bytes, measurement);
  }
  torch::NoGradGuard no_grad;
  std::vector<Tensor> weights, maps;
  for (const Layer& layer : conv_) weights.push_back(layer.weight);
  const int64_t chunk_rows = is_resnet_ ? kResnetChunkRows : kChunkRows;
  for (int64_t first = 0; first < rows; first += chunk_rows) {
    const int64_t count = std::min(chunk_rows, rows - first);
    const auto chunk = frames.subspan(static_cast<size_t>(first), static_cast<size_t>(count));
    const int64_t sizes[] = {count, env_.channels, env_.height, env_.width};
    if (is_resnet_) {
      const Tensor pixels = torch::empty(sizes);
      normalizer_->frame.normalize_rows(chunk, pixels.data_ptr<float>());
      maps.push_back(convolutions(pixels));
      continue;
    }
    PixelConvolutions& stack = PixelConvolutions::of(sizes, weights, strides_, precision_);
    Tensor x = stack.pixels(chunk, normalizer_->frame.factor(), normalizer_->frame.offset(), kClip);
    for (size_t layer = 0; layer < conv_.size(); ++layer)
      x = stack.forward(layer, x, conv_[layer].weight, conv_[layer].bias);
    maps.push_back(stack.to_features(x));
  }
  return features(maps.size() == 1 ? maps.front() : at::cat(maps), measurement);
}

/// The convolutions as plain operators: for accelerators, and resnet_impala's without a gradient.
Tensor Encoder::convolutions(Tensor x) const {
  if (is_resnet_) {
    std::vector<Tensor> weights, biases;
    for (const Layer& conv : conv_) {
      weights.push_back(conv.weight);
      biases.push_back(conv.bias);
    }
    return resnet_maps(x, weights, biases, precision_);
  }
  for (size_t index = 0; index < conv_.size(); ++index) {
    x = convolve(x, conv_[index].weight, conv_[index].bias, strides_[index], 0, precision_);
    at::elu_(x);
  }
  return x.flatten(1);
}

Tensor Encoder::features(const Tensor& map, const Tensor& measurement) const {
  const Tensor x = dense_elu(map, image_.weight, image_.bias, precision_);
  if (env_.measurement_count == 0) return x;
  COMRAD_CHECK(measurement.defined() && measurement.size(-1) == env_.measurement_count,
               "this shape has a measurement vector");
  Tensor m = normalizer_->measurement.normalize(
      measurement.reshape({x.size(0), env_.measurement_count}).to(device_));
  for (const Layer& layer : measurement_) m = dense_elu(m, layer.weight, layer.bias, precision_);
  return at::cat({x, m}, 1);
}

void Encoder::update_statistics(const Tensor& frame, const Tensor& measurement, const AddUp& add_up_frames) {
  normalizer_->frame.update(frame, add_up_frames);
  if (env_.measurement_count > 0 && measurement.defined()) normalizer_->measurement.update(measurement);
}

int64_t Encoder::feature_count() const {
  return kImageFeatures + (env_.measurement_count > 0 ? kMeasurementFeatures : 0);
}

NamedTensors Encoder::named_parameters() const {
  NamedTensors named;
  const auto add = [&](const Layer& layer) {
    named.emplace_back("encoder." + layer.name + ".weight", layer.weight);
    named.emplace_back("encoder." + layer.name + ".bias", layer.bias);
  };
  for (const Layer& layer : conv_) add(layer);
  add(image_);
  for (const Layer& layer : measurement_) add(layer);
  return named;
}

NamedTensors Encoder::named_buffers() const { return normalizer_->named_buffers(); }

}  // namespace comrad::policy
