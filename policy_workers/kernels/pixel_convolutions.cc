#include "policy_workers/kernels/pixel_convolutions.h"

#include <map>
#include <oneapi/dnnl/dnnl.hpp>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/elementwise.h"
#include "policy_workers/kernels/packed_kernel.h"
#include "policy_workers/kernels/precision.h"
#include "policy_workers/kernels/weight_cache.h"

namespace comrad::policy {
namespace {

using dnnl::memory;
using torch::Tensor;

const dnnl::engine& cpu() {
  static const dnnl::engine engine(dnnl::engine::kind::cpu, 0);
  return engine;
}

dnnl::stream& stream() {
  thread_local dnnl::stream stream(cpu());
  return stream;
}

memory in_layout(const Tensor& tensor, const memory::desc& layout) {
  return {layout, cpu(), tensor.data_ptr()};
}

Tensor room_for(const memory::desc& layout) {
  return torch::empty({static_cast<int64_t>(layout.get_size())}, torch::kUInt8);
}

void copy(const Tensor& from, const memory::desc& its_layout, const Tensor& to, const memory::desc& layout) {
  memory source = in_layout(from, its_layout), target = in_layout(to, layout);
  dnnl::reorder(source, target).execute(stream(), source, target);
}

/// The same numbers in another layout or type.
Tensor laid_out(const Tensor& x, const memory::desc& its_layout, const memory::desc& layout) {
  if (its_layout == layout) return x;
  Tensor out = room_for(layout);
  copy(x, its_layout, out, layout);
  return out;
}

// oneDNN 2 (Debian 12) keeps the values of a description in its own struct; oneDNN 3 (Debian 13) takes them one by one.
#if DNNL_VERSION_MAJOR < 3
void append_elu(dnnl::post_ops& operations) {
  operations.append_eltwise(1.0f, dnnl::algorithm::eltwise_elu, 1.0f, 0.0f);
}
template <typename Primitive, typename... Values>
typename Primitive::primitive_desc describe(const dnnl::primitive_attr& attributes, const Values&... values) {
  return {typename Primitive::desc(values...), attributes, cpu()};
}
template <typename Primitive, typename... Values>
typename Primitive::primitive_desc describe_backward(const dnnl::convolution_forward::primitive_desc& forward,
                                                     const dnnl::primitive_attr& attributes,
                                                     const Values&... values) {
  return {typename Primitive::desc(values...), attributes, cpu(), forward};
}
#else
void append_elu(dnnl::post_ops& operations) {
  operations.append_eltwise(dnnl::algorithm::eltwise_elu, 1.0f, 0.0f);
}
template <typename Primitive, typename... Values>
typename Primitive::primitive_desc describe(const dnnl::primitive_attr& attributes, const Values&... values) {
  return {cpu(), values..., attributes};
}
template <typename Primitive, typename... Values>
typename Primitive::primitive_desc describe_backward(const dnnl::convolution_forward::primitive_desc& forward,
                                                     const dnnl::primitive_attr& attributes,
                                                     const Values&... values) {
  return {cpu(), values..., forward, attributes};
}
#endif

/// A description by the first of oneDNN's ways that works here. Beside a PyTorch from pip, which has another oneDNN inside, the ways over
/// matrix products do not: both make their kernels in a std::call_once() of one name, and the loader lets PyTorch's answer for both.
template <typename Description>
Description working(Description description) {
#ifdef COMRAD_TORCH_HAS_ONEDNN
  while (std::string_view(description.impl_info_str()).find("gemm") != std::string_view::npos &&
         description.next_impl()) {
  }
#endif
  return description;
}

/// A primitive, and the description that it was made from.
template <typename Primitive>
struct Made {
  using Description = typename Primitive::primitive_desc;
  explicit Made(const Description& from) : description(working(from)), primitive(description) {}

  void run(std::unordered_map<int, memory> arguments) const {
    const memory::desc scratchpad = description.scratchpad_desc();
    const Tensor scratch = room_for(scratchpad);
    arguments.emplace(DNNL_ARG_SCRATCHPAD, in_layout(scratch, scratchpad));
    primitive.execute(stream(), arguments);
  }

  Description description;
  Primitive primitive;
};

memory::desc any(const memory::dims& sizes, memory::data_type type) {
  return {sizes, type, memory::format_tag::any};
}

dnnl::primitive_attr attributes(bool with_elu) {
  dnnl::primitive_attr attributes;
  attributes.set_scratchpad_mode(dnnl::scratchpad_mode::user);
  if (with_elu) {
    dnnl::post_ops elu;
    append_elu(elu);
    attributes.set_post_ops(elu);
  }
  return attributes;
}

constexpr auto kForward = dnnl::prop_kind::forward_training;
constexpr auto kDirect = dnnl::algorithm::convolution_direct;
const memory::dims kNoPadding = {0, 0};
using kernels::kPatch;

/// Weights [O, C, 4 h, 4 w] of stride 4 as those over patches [O, 16 C, h, w] of stride 1, and back.
Tensor over_patches(const Tensor& weight) {
  const int64_t outputs = weight.size(0), channels = weight.size(1);
  const int64_t height = weight.size(2) / kPatch, width = weight.size(3) / kPatch;
  return weight.reshape({outputs, channels, height, kPatch, width, kPatch})
      .permute({0, 1, 3, 5, 2, 4})
      .reshape({outputs, channels * kPatch * kPatch, height, width});
}
Tensor over_pixels(const Tensor& weight) {
  const int64_t outputs = weight.size(0), channels = weight.size(1) / (kPatch * kPatch);
  const int64_t height = weight.size(2), width = weight.size(3);
  return weight.view({outputs, channels, kPatch, kPatch, height, width})
      .permute({0, 1, 4, 2, 5, 3})
      .reshape({outputs, channels, height * kPatch, width * kPatch});
}

}  // namespace

struct PixelConvolutions::Layer {
  /// For x [rows, inputs, height, width] in the layout `comes`.
  Layer(const memory::dims& x, const memory::desc& comes, const memory::dims& kernels, int64_t stride,
        memory::data_type numbers)
      : input_sizes(x),
        weight_sizes(kernels),
        output_sizes({x[0], kernels[0], (x[2] - kernels[2]) / stride + 1, (x[3] - kernels[3]) / stride + 1}),
        strides({stride, stride}),
        type(numbers),
        input(comes),
        plain_weight(kernels, memory::data_type::f32, memory::format_tag::oihw),
        bias({kernels[0]}, memory::data_type::f32, memory::format_tag::x),
        forward(describe<dnnl::convolution_forward>(
            attributes(/*with_elu=*/true), kForward, kDirect, any(input_sizes, type), any(weight_sizes, type),
            bias, any(output_sizes, type), strides, kNoPadding, kNoPadding)) {}

  memory::desc output() const { return forward.description.dst_desc(); }

  /// Made at the first gradient, which a policy worker never requests; the second not for pixels.
  const Made<dnnl::convolution_backward_weights>& weight_gradient() {
    if (!to_weight)
      to_weight.emplace(describe_backward<dnnl::convolution_backward_weights>(
          forward.description, attributes(/*with_elu=*/false), kDirect, any(input_sizes, type),
          any(weight_sizes, memory::data_type::f32), bias, any(output_sizes, type), strides, kNoPadding,
          kNoPadding));
    return *to_weight;
  }
  const Made<dnnl::convolution_backward_data>& input_gradient() {
    if (!to_input)
      to_input.emplace(describe_backward<dnnl::convolution_backward_data>(
          forward.description, attributes(/*with_elu=*/false), kDirect, any(input_sizes, type),
          any(weight_sizes, type), any(output_sizes, type), strides, kNoPadding, kNoPadding));
    return *to_input;
  }

  memory::dims input_sizes, weight_sizes, output_sizes, strides;
  memory::data_type type;
  memory::desc input;  ///< from the layer before
  memory::desc plain_weight, bias;
  Made<dnnl::convolution_forward> forward;
  std::optional<Made<dnnl::convolution_backward_weights>> to_weight;
  std::optional<Made<dnnl::convolution_backward_data>> to_input;
  WeightCache forward_weights, backward_weights;
};

struct PixelConvolutions::Stack {
  std::vector<Layer> layers;
  memory::data_type type = memory::data_type::f32;
  bool rounds = false;  ///< factors, which are f32
  int64_t channels = 0, height = 0, width = 0;
  /// Patches that the first layer reads; 0: it reads pixels.
  int64_t patch_rows = 0, patch_columns = 0;
  WeightCache patch_factors, patch_offsets;

  /// Numbers [channels, height, width] in the order of patches.
  Tensor in_patches(WeightCache& cache, const Tensor& numbers) const {
    if (patch_rows == 0) return numbers;
    return cache.get(numbers, [this](const Tensor& all) {
      return all.view({channels, height, width})
          .slice(1, 0, patch_rows * kPatch)
          .slice(2, 0, patch_columns * kPatch)
          .reshape({channels, patch_rows, kPatch, patch_columns, kPatch})
          .permute({0, 1, 3, 2, 4})
          .contiguous();
    });
  }

  /// x as a factor of a product.
  Tensor factor(const Tensor& x) const {
    if (!rounds) return x;
    const Tensor rounded = x.clone();
    kernels::round_to_bf16(static_cast<float*>(rounded.data_ptr()),
                           static_cast<int64_t>(rounded.nbytes() / sizeof(float)));
    return rounded;
  }
  Tensor weight_for(WeightCache& cache, const Tensor& weight, const Layer& layer,
                    const memory::desc& layout) const {
    return cache.get(weight, [&](const Tensor& detached) {
      const bool is_patched = patch_rows > 0 && &layer == &layers.front();
      const Tensor plain = is_patched ? over_patches(detached) : detached.contiguous();
      return laid_out(factor(plain), layer.plain_weight, layout);
    });
  }
  memory::desc plain_output() const { return {layers.back().output_sizes, type, memory::format_tag::nchw}; }
};

PixelConvolutions::PixelConvolutions() : stack_(new Stack) {}
PixelConvolutions::~PixelConvolutions() = default;

PixelConvolutions& PixelConvolutions::of(at::IntArrayRef input, std::span<const Tensor> weights,
                                         at::IntArrayRef strides, Precision precision) {
  thread_local std::map<std::vector<int64_t>, std::unique_ptr<PixelConvolutions>> made;
  std::vector<int64_t> key = input.vec();
  for (std::size_t layer = 0; layer < strides.size(); ++layer) {
    const at::IntArrayRef sizes = weights[layer].sizes();
    key.insert(key.end(), sizes.begin(), sizes.end());
    key.push_back(strides[layer]);
  }
  key.push_back(static_cast<int64_t>(precision));
  key.push_back(at::get_num_threads());  // a primitive is made for a number of them
  if (const auto known = made.find(key); known != made.end()) return *known->second;
  std::unique_ptr<PixelConvolutions> fresh(new PixelConvolutions);
  Stack& stack = *fresh->stack_;
  const bool multiplies = precision == Precision::kBf16 && multiplies_bf16(torch::kCPU);
  stack.type = multiplies ? memory::data_type::bf16 : memory::data_type::f32;
  stack.rounds = precision == Precision::kBf16 && !multiplies;
  stack.channels = input[1], stack.height = input[2], stack.width = input[3];
  memory::dims sizes = input.vec();
  memory::format_tag order = memory::format_tag::nchw;
  const memory::dims first = weights[0].sizes().vec();
  const bool has_patches = strides[0] == kPatch && first[2] % kPatch == 0 && first[3] % kPatch == 0;
  if (has_patches) {
    stack.patch_rows = (sizes[2] - first[2]) / kPatch + first[2] / kPatch;
    stack.patch_columns = (sizes[3] - first[3]) / kPatch + first[3] / kPatch;
    sizes = {sizes[0], sizes[1] * kPatch * kPatch, stack.patch_rows, stack.patch_columns};
    order = memory::format_tag::nChw16c;
  }
  memory::desc layout(sizes, stack.type, order);
  for (std::size_t layer = 0; layer < strides.size(); ++layer) {
    const bool is_patched = has_patches && layer == 0;
    const Tensor weight = is_patched ? over_patches(weights[layer].detach()) : weights[layer];
    stack.layers.emplace_back(sizes, layout, weight.sizes().vec(), is_patched ? 1 : strides[layer],
                              stack.type);
    sizes = stack.layers.back().output_sizes;
    layout = stack.layers.back().output();
  }
  return *made.emplace(std::move(key), std::move(fresh)).first->second;
}

torch::ScalarType PixelConvolutions::type() const {
  return stack_->type == memory::data_type::bf16 ? torch::kBFloat16 : torch::kFloat32;
}

Tensor PixelConvolutions::pixels(std::span<const uint8_t* const> rows, const Tensor& factor,
                                 const Tensor& offset, float clip) {
  Stack& stack = *stack_;
  const Tensor its_factor = stack.in_patches(stack.patch_factors, factor),
               its_offset = stack.in_patches(stack.patch_offsets, offset);
  const int64_t count = its_factor.numel();
  std::vector<const uint8_t*> ordered(rows.begin(), rows.end());
  Tensor patches;
  if (stack.patch_rows > 0) {
    patches = torch::empty({static_cast<int64_t>(rows.size()), count}, torch::kUInt8);
    for (std::size_t row = 0; row < rows.size(); ++row) {
      uint8_t* const to = patches.data_ptr<uint8_t>() + static_cast<int64_t>(row) * count;
      kernels::gather_patches(rows[row], stack.channels, stack.height, stack.width, stack.patch_rows,
                              stack.patch_columns, to);
      ordered[row] = to;
    }
  }
  const Tensor x = torch::empty({static_cast<int64_t>(rows.size()), count}, type());
  if (type() == torch::kBFloat16)
    kernels::normalize_bytes_bf16(ordered, count, its_factor.data_ptr<float>(), its_offset.data_ptr<float>(),
                                  clip, static_cast<uint16_t*>(x.data_ptr()));
  else
    kernels::normalize_bytes(ordered, count, its_factor.data_ptr<float>(), its_offset.data_ptr<float>(), clip,
                             x.data_ptr<float>());
  return x;
}

Tensor PixelConvolutions::forward(std::size_t index, const Tensor& x, const Tensor& weight,
                                  const Tensor& bias) {
  Layer& layer = stack_->layers[index];
  const auto& description = layer.forward.description;
  const Tensor in = laid_out(stack_->factor(x), layer.input, description.src_desc());
  const Tensor factors = stack_->weight_for(layer.forward_weights, weight, layer, description.weights_desc());
  Tensor y = room_for(layer.output());
  layer.forward.run({{DNNL_ARG_SRC, in_layout(in, description.src_desc())},
                     {DNNL_ARG_WEIGHTS, in_layout(factors, description.weights_desc())},
                     {DNNL_ARG_BIAS, in_layout(bias, layer.bias)},
                     {DNNL_ARG_DST, in_layout(y, layer.output())}});
  return y;
}

PixelConvolutions::Gradients PixelConvolutions::backward(std::size_t index, const Tensor& x, const Tensor& y,
                                                         Tensor grad, const Tensor& weight) {
  Layer& layer = stack_->layers[index];
  // By ELU's result; the two lie in the same order.
  if (layer.type == memory::data_type::bf16)
    kernels::elu_backward_bf16(static_cast<const uint16_t*>(y.data_ptr()),
                               static_cast<uint16_t*>(grad.data_ptr()),
                               static_cast<int64_t>(grad.nbytes() / sizeof(uint16_t)));
  else
    kernels::elu_backward(static_cast<const float*>(y.data_ptr()), static_cast<float*>(grad.data_ptr()),
                          static_cast<int64_t>(grad.nbytes() / sizeof(float)));
  grad = stack_->factor(grad);
  Gradients gradients;
  {
    const auto& to_weight = layer.weight_gradient();
    const auto& description = to_weight.description;
    const Tensor in = laid_out(stack_->factor(x), layer.input, description.src_desc());
    const Tensor out = laid_out(grad, layer.output(), description.diff_dst_desc());
    const Tensor sums = room_for(description.diff_weights_desc());
    gradients.bias = torch::empty({layer.weight_sizes[0]}, torch::kFloat32);
    to_weight.run({{DNNL_ARG_SRC, in_layout(in, description.src_desc())},
                   {DNNL_ARG_DIFF_DST, in_layout(out, description.diff_dst_desc())},
                   {DNNL_ARG_DIFF_WEIGHTS, in_layout(sums, description.diff_weights_desc())},
                   {DNNL_ARG_DIFF_BIAS, in_layout(gradients.bias, layer.bias)}});
    gradients.weight = torch::empty(layer.weight_sizes, torch::kFloat32);
    copy(sums, description.diff_weights_desc(), gradients.weight, layer.plain_weight);
    if (index == 0 && stack_->patch_rows > 0) gradients.weight = over_pixels(gradients.weight);
  }
  if (index == 0) return gradients;
  const auto& to_input = layer.input_gradient();
  const auto& description = to_input.description;
  const Tensor out = laid_out(grad, layer.output(), description.diff_dst_desc());
  const Tensor factors =
      stack_->weight_for(layer.backward_weights, weight, layer, description.weights_desc());
  const Tensor in = room_for(description.diff_src_desc());
  to_input.run({{DNNL_ARG_DIFF_DST, in_layout(out, description.diff_dst_desc())},
                {DNNL_ARG_WEIGHTS, in_layout(factors, description.weights_desc())},
                {DNNL_ARG_DIFF_SRC, in_layout(in, description.diff_src_desc())}});
  gradients.x = laid_out(in, description.diff_src_desc(), layer.input);
  return gradients;
}

Tensor PixelConvolutions::to_features(const Tensor& y) const {
  const Layer& last = stack_->layers.back();
  const memory::dims& sizes = last.output_sizes;
  Tensor features = torch::empty({sizes[0], sizes[1] * sizes[2] * sizes[3]}, type());
  copy(y, last.output(), features, stack_->plain_output());
  return features;
}

Tensor PixelConvolutions::from_features(const Tensor& features) const {
  const Layer& last = stack_->layers.back();
  Tensor y = room_for(last.output());
  copy(features.to(type()).contiguous(), stack_->plain_output(), y, last.output());
  return y;
}

}  // namespace comrad::policy
