#include "policy_workers/network/layer_encoder.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/pixel_path.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/settings/encoder_layers.h"

namespace comrad::policy {
namespace {

constexpr int64_t kMeasurementFeatures = 128;
/// Rows that operators compute together on a CPU: the ResNet's first stage works at the frame's full size.
constexpr int64_t kOperatorChunkRows = 32;

Tensor activated(const Tensor& x, Activation activation) {
  switch (activation) {
    case Activation::kNone:
      return x;
    case Activation::kElu:
      return at::elu(x);
    case Activation::kRelu:
      return at::relu(x);
    case Activation::kTanh:
      return at::tanh(x);
    case Activation::kGelu:
      return at::gelu(x);
    case Activation::kSilu:
      return at::silu(x);
  }
  return x;
}

/// The same of a fresh result; ELU in place, as its derivative is a function of the result.
Tensor activated_in_place(Tensor x, Activation activation) {
  if (activation == Activation::kElu) return at::elu_(x);
  return activated(x, activation);
}

/// A convolution with its bias; the product in the given precision, the result f32, except where keeps_bf16().
Tensor convolve(const Tensor& x, const Tensor& weight, const Tensor& bias, int64_t stride, int64_t padding,
                Precision precision) {
  if (precision == Precision::kFp32) return at::conv2d(x, weight, bias, stride, padding);
  const Tensor in = factor(x, precision), kernel = weight_factor(weight, precision);
  if (keeps_bf16(x.device(), precision))
    return at::conv2d(in, kernel, weight_factor(bias, precision), stride, padding);
  return at::conv2d(in, kernel, Tensor(), stride, padding) +
         bias.view({1, -1, 1, 1});  // in f32, as the wider of the two
}

/// A layer with its tensors: none, weight and bias, or two of each (residual).
struct WeightedLayer {
  EncoderLayer layer;
  std::size_t first_tensor = 0;  ///< in the encoder's list
};

/// The layers one after the other as plain operators; `tensors` is the encoder's list.
Tensor run_layers(Tensor x, std::span<const WeightedLayer> layers, std::span<const Tensor> tensors,
                  Precision precision) {
  for (const WeightedLayer& weighted : layers) {
    const EncoderLayer& layer = weighted.layer;
    const std::size_t first = weighted.first_tensor;
    switch (layer.kind) {
      case LayerKind::kConv:
        x = activated_in_place(
            convolve(x, tensors[first], tensors[first + 1], layer.stride, layer.padding, precision),
            layer.activation);
        break;
      case LayerKind::kPool:
        x = at::max_pool2d(x, layer.kernel, layer.stride, layer.padding);
        break;
      case LayerKind::kResidual: {
        Tensor inner = convolve(at::elu(x), tensors[first], tensors[first + 1], 1, 1, precision);
        at::elu_(inner);
        x = x + convolve(inner, tensors[first + 2], tensors[first + 3], 1, 1, precision);
        break;
      }
      case LayerKind::kLayerNorm:
        x = layer_norm(x, tensors[first], tensors[first + 1]);
        break;
      case LayerKind::kFlatten:
        x = x.flatten(1);
        break;
      case LayerKind::kLinear:
        x = activated_in_place(linear(x, tensors[first], tensors[first + 1], precision), layer.activation);
        break;
      case LayerKind::kActivation:
        x = activated(x, layer.activation);
        break;
    }
  }
  return x;
}

/// The layers before flatten on a CPU, in chunks that are computed a second time on the way back: the ResNet's activations
/// take 2 MB a frame, so a graph over a whole micro-batch would not fit beside the rest of a small machine's work. All
/// tensors come in one flat one, because a custom function takes a fixed number of them.
struct ChunkedLayers : torch::autograd::Function<ChunkedLayers> {
  using Context = torch::autograd::AutogradContext;
  using TensorList = torch::autograd::tensor_list;
  using Sizes = std::vector<std::vector<int64_t>>;

  /// Shared by both passes; saved_data cannot hold it.
  struct Plan {
    std::vector<WeightedLayer> layers;
    Sizes sizes;  ///< of the tensors
    Precision precision = Precision::kFp32;
  };

  static Tensor chunk_maps(const Tensor& chunk, const Tensor& scale, const Tensor& offset,
                           const Tensor& packed, const Plan& plan) {
    std::vector<Tensor> tensors;
    int64_t next = 0;
    for (const std::vector<int64_t>& sizes : plan.sizes) {
      const int64_t count = c10::multiply_integers(sizes);
      tensors.push_back(packed.slice(0, next, next + count).view(sizes));
      next += count;
    }
    return run_layers(normalize_bytes(chunk.flatten(1), scale, offset).view_as(chunk), plan.layers, tensors,
                      plan.precision);
  }

  static Tensor forward(Context* context, const Tensor& frame, const Tensor& scale, const Tensor& offset,
                        const Tensor& packed, const Plan* plan) {
    TensorList outputs;
    for (int64_t first = 0; first < frame.size(0); first += kOperatorChunkRows)
      outputs.push_back(
          chunk_maps(frame.slice(0, first, first + kOperatorChunkRows), scale, offset, packed, *plan));
    context->save_for_backward({frame, scale, offset, packed});
    context->saved_data["plan"] = static_cast<int64_t>(reinterpret_cast<intptr_t>(plan));
    return at::cat(outputs);
  }

  static TensorList backward(Context* context, TensorList grad_outputs) {
    const TensorList saved = context->get_saved_variables();
    const auto* plan = reinterpret_cast<const Plan*>(  // NOLINT: the encoder outlives its graphs
        static_cast<intptr_t>(context->saved_data["plan"].toInt()));
    torch::AutoGradMode with_gradient(true);
    const Tensor packed = saved[3].detach().requires_grad_();
    for (int64_t first = 0; first < saved[0].size(0); first += kOperatorChunkRows) {
      const Tensor output =
          chunk_maps(saved[0].slice(0, first, first + kOperatorChunkRows), saved[1], saved[2], packed, *plan);
      output.backward(grad_outputs[0].slice(0, first, first + kOperatorChunkRows));
    }
    return {Tensor(), Tensor(), Tensor(), packed.grad().detach(), Tensor()};
  }
};

class LayerEncoder : public Encoder {
 public:
  LayerEncoder(const EncoderInput& input, const LayerMaker& make)
      : Encoder(input.env, make.device), precision_(make.precision), normalizer_(input.normalizer) {
    Expected<std::vector<EncoderLayer>> layers = parse_encoder(input.encoder);
    COMRAD_CHECK(layers.has_value(), "the encoder was checked: its layers are read");
    if (input.layer_norm) layers = with_layer_norm(*layers);
    LayerShape shape = {env_.channels, env_.height, env_.width};
    for (const EncoderLayer& layer : *layers) {
      std::vector<WeightedLayer>& part =
          shape.is_flat || layer.kind == LayerKind::kFlatten ? dense_ : maps_.layers;
      part.push_back({layer, tensors_.size()});
      add_tensors(layer, shape, make);
      const Expected<LayerShape> after = shape_after(layer, shape);
      COMRAD_CHECK(after.has_value(), "frames must be large enough for the encoder");
      shape = *after;
      if (!shape.is_flat) map_tensors_ = tensors_.size();
    }
    COMRAD_CHECK(shape.is_flat, "the encoder was checked: it ends in features");
    image_features_ = shape.channels;
    for (std::size_t i = 0; i < map_tensors_; ++i) maps_.sizes.push_back(tensors_[i].sizes().vec());
    maps_.precision = precision_;
    fits_pixel_path_ = fits_pixel_path();
    if (env_.measurement_count > 0) {
      measurement_.push_back(make("measurement1", {kMeasurementFeatures, env_.measurement_count}));
      measurement_.push_back(make("measurement2", {kMeasurementFeatures, kMeasurementFeatures}));
      for (const char* name : {"measurement1_norm", "measurement2_norm"})
        if (input.layer_norm) measurement_norms_.push_back(make.norm(name, {kMeasurementFeatures}));
    }
  }

  Tensor forward(const Tensor& frame, const Tensor& measurement) const override {
    const Tensor bytes =
        frame.reshape({frame.size(0), env_.channels, env_.height, env_.width}).to(device_).contiguous();
    return features(maps(bytes), measurement);
  }

  Tensor forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const override {
    if (!device::has_own_kernels(device_)) return Encoder::forward_rows(frames, measurement);
    torch::NoGradGuard no_grad;
    const auto rows = static_cast<int64_t>(frames.size());
    const int64_t sizes[] = {rows, env_.channels, env_.height, env_.width};
    if (fits_pixel_path_)
      return features(pixel_features(frames, sizes, scale(), stack(), precision_), measurement);
    std::vector<Tensor> chunks;
    for (int64_t first = 0; first < rows; first += kOperatorChunkRows) {
      const int64_t count = std::min(kOperatorChunkRows, rows - first);
      const Tensor pixels = torch::empty({count, env_.channels, env_.height, env_.width});
      normalizer_->frame.normalize_rows(
          frames.subspan(static_cast<size_t>(first), static_cast<size_t>(count)), pixels.data_ptr<float>());
      chunks.push_back(run_layers(pixels, maps_.layers, tensors_, precision_));
    }
    return features(chunks.size() == 1 ? chunks.front() : at::cat(chunks), measurement);
  }

  int64_t feature_count() const override {
    return image_features_ + (env_.measurement_count > 0 ? kMeasurementFeatures : 0);
  }

  NamedTensors named_parameters() const override {
    NamedTensors named;
    for (std::size_t i = 0; i < tensors_.size(); ++i) named.emplace_back("encoder." + names_[i], tensors_[i]);
    for (const Layer& layer : measurement_) append(named, "encoder.", layer);
    for (const Layer& norm : measurement_norms_) append(named, "encoder.", norm);
    return named;
  }

  std::string implementation() const override {
    if (!device::has_own_kernels(device_)) return "operators";
    return fits_pixel_path_ ? "oneDNN convolutions" : "operators in chunks";
  }

 private:
  void add_tensors(const EncoderLayer& layer, const LayerShape& input, const LayerMaker& make) {
    const auto add = [this](const Layer& made) {
      for (const char* kind : {".weight", ".bias"}) names_.push_back(made.name + kind);
      tensors_.push_back(made.weight);
      tensors_.push_back(made.bias);
    };
    const auto next_conv = [this] { return fmt::format("conv{}", ++convolutions_); };
    switch (layer.kind) {
      case LayerKind::kConv:
        add(make(next_conv(), {layer.outputs, input.channels, layer.kernel, layer.kernel}));
        break;
      case LayerKind::kResidual:
        for (int i = 0; i < 2; ++i) add(make(next_conv(), {input.channels, input.channels, 3, 3}));
        break;
      case LayerKind::kLinear:
        ++linears_;
        add(make(linears_ == 1 ? "image" : fmt::format("image{}", linears_),
                 {layer.outputs, input.channels}));
        break;
      case LayerKind::kLayerNorm: {
        const std::vector<int64_t> sizes =
            input.is_flat ? std::vector<int64_t>{input.channels}
                          : std::vector<int64_t>{input.channels, input.height, input.width};
        add(make.norm(fmt::format("norm{}", ++norms_), sizes));
        break;
      }
      case LayerKind::kPool:
      case LayerKind::kFlatten:
      case LayerKind::kActivation:
        break;
    }
  }

  /// Whether the layers before flatten are what kernels/pixel_path.h computes.
  bool fits_pixel_path() const {
    return maps_.layers.size() >= kPixelLayersMin && maps_.layers.size() <= kPixelLayersMax &&
           std::ranges::all_of(maps_.layers, [](const WeightedLayer& weighted) {
             return weighted.layer.kind == LayerKind::kConv && weighted.layer.padding == 0 &&
                    weighted.layer.activation == Activation::kElu;
           });
  }

  PixelScale scale() const { return {normalizer_->frame.factor(), normalizer_->frame.offset(), kInputClip}; }
  PixelStack stack() const {
    PixelStack stack;
    for (const WeightedLayer& weighted : maps_.layers) {
      stack.weights.push_back(tensors_[weighted.first_tensor]);
      stack.biases.push_back(tensors_[weighted.first_tensor + 1]);
      stack.strides.push_back(weighted.layer.stride);
    }
    return stack;
  }

  /// The layers before flatten; the pixel path flattens.
  Tensor maps(const Tensor& bytes) const {
    const InputNormalizer& normalizer = normalizer_->frame;
    if (!device::has_own_kernels(device_) || map_tensors_ == 0) {
      const bool rounds =
          keeps_bf16(device_, precision_) && !maps_.layers.empty() &&
          maps_.layers.front().layer.kind == LayerKind::kConv;  // which rounds its input anyway
      const Tensor pixels =
          normalizer.normalize(bytes.flatten(1), rounds ? torch::kBFloat16 : torch::kFloat32);
      return run_layers(pixels.view_as(bytes), maps_.layers, tensors_, precision_);
    }
    if (fits_pixel_path_) return pixel_features(bytes, scale(), stack(), precision_);
    std::vector<Tensor> flat;
    for (std::size_t i = 0; i < map_tensors_; ++i) flat.push_back(tensors_[i].flatten());
    return ChunkedLayers::apply(bytes, normalizer.factor(), normalizer.offset(), at::cat(flat), &maps_);
  }

  Tensor features(const Tensor& maps, const Tensor& measurement) const {
    const Tensor x = run_layers(maps, dense_, tensors_, precision_);
    if (env_.measurement_count == 0) return x;
    COMRAD_CHECK(measurement.defined() && measurement.size(-1) == env_.measurement_count,
                 "this shape has a measurement vector");
    Tensor m = normalizer_->measurement.normalize(
        measurement.reshape({x.size(0), env_.measurement_count}).to(device_));
    for (std::size_t i = 0; i < measurement_.size(); ++i) {
      m = linear(m, measurement_[i].weight, measurement_[i].bias, precision_);
      if (!measurement_norms_.empty())
        m = layer_norm(m, measurement_norms_[i].weight, measurement_norms_[i].bias);
      m = activated_in_place(m, Activation::kElu);
    }
    return at::cat({x, m}, 1);
  }

  Precision precision_;
  std::shared_ptr<const ObservationNormalizer> normalizer_;
  std::vector<Tensor> tensors_;  // of the layers, weight and bias in turn
  std::vector<std::string> names_;
  ChunkedLayers::Plan maps_;          // before flatten
  std::vector<WeightedLayer> dense_;  // flatten and what follows
  std::size_t map_tensors_ = 0;       // how many of tensors_ belong to maps_
  bool fits_pixel_path_ = false;
  int64_t image_features_ = 0;
  int convolutions_ = 0, norms_ = 0, linears_ = 0;
  std::vector<Layer> measurement_;        // M -> 128 -> 128
  std::vector<Layer> measurement_norms_;  // none without layer_norm
};

}  // namespace

std::shared_ptr<const Encoder> make_layer_encoder(const EncoderInput& input, const LayerMaker& make) {
  return std::make_shared<LayerEncoder>(input, make);
}

}  // namespace comrad::policy
