#include "policy_workers/kernels/pixel_path.h"

#include <algorithm>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/pixel_convolutions.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

using torch::Tensor;

/// Rows that pass all layers together: their activations stay in the caches on the way, and memory grows with the rows only by
/// what the backward pass needs.
constexpr int64_t kPixelChunkRows = 64;

/// Of two layers the third has empty tensors, because a custom function takes a fixed number of them.
///
/// Autograd's own graph would hold the normalised pixels of the whole batch and pass every layer over the
/// whole batch; this one keeps three activations per chunk and normalises the pixels a second time on the
/// way back.
struct PixelPath : torch::autograd::Function<PixelPath> {
  using Context = torch::autograd::AutogradContext;
  using TensorList = torch::autograd::tensor_list;

  static Tensor forward(Context* context, const Tensor& frame, const Tensor& factor, const Tensor& offset,
                        const Tensor& w1, const Tensor& b1, const Tensor& w2, const Tensor& b2,
                        const Tensor& w3, const Tensor& b3, const std::vector<int64_t>& strides, double clip,
                        Precision precision) {
    const Tensor weights[] = {w1, w2, w3}, biases[] = {b1, b2, b3};
    TensorList saved = {w1, w2, w3, frame, factor, offset}, outputs;
    for (int64_t first = 0; first < frame.size(0); first += kPixelChunkRows) {
      const Tensor chunk = frame.slice(0, first, first + kPixelChunkRows);
      PixelConvolutions& stack = PixelConvolutions::of(chunk.sizes(), weights, strides, precision);
      Tensor x = stack.pixels(rows_of(chunk), factor, offset, static_cast<float>(clip));
      for (size_t layer = 0; layer < strides.size(); ++layer)
        saved.push_back(x = stack.forward(layer, x, weights[layer], biases[layer]));
      outputs.push_back(stack.to_features(x));
    }
    context->save_for_backward(saved);
    context->saved_data["strides"] = strides;
    context->saved_data["clip"] = clip;
    context->saved_data["precision"] = static_cast<int64_t>(precision);
    return at::cat(outputs);
  }

  static TensorList backward(Context* context, TensorList grad_outputs) {
    const std::vector<int64_t> strides = context->saved_data["strides"].toIntVector();
    const auto clip = static_cast<float>(context->saved_data["clip"].toDouble());
    const auto precision = static_cast<Precision>(context->saved_data["precision"].toInt());
    const size_t layers = strides.size();
    const TensorList saved = context->get_saved_variables();
    const Tensor &frame = saved[3], &factor = saved[4], &offset = saved[5];
    Tensor weight_gradient[3], bias_gradient[3];
    size_t next = 6;
    for (int64_t first = 0; first < frame.size(0); first += kPixelChunkRows, next += layers) {
      const Tensor chunk = frame.slice(0, first, first + kPixelChunkRows);
      PixelConvolutions& stack = PixelConvolutions::of(chunk.sizes(), saved, strides, precision);
      Tensor grad = stack.from_features(grad_outputs[0].slice(0, first, first + kPixelChunkRows));
      for (size_t layer = layers; layer-- > 0;) {
        const Tensor x =
            layer > 0 ? saved[next + layer - 1] : stack.pixels(rows_of(chunk), factor, offset, clip);
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
            bias_gradient[2], Tensor(),           Tensor(),         Tensor()};
  }
};

void check_stack(const PixelStack& stack) {
  COMRAD_CHECK(stack.weights.size() >= kPixelLayersMin && stack.weights.size() <= kPixelLayersMax &&
                   stack.biases.size() == stack.weights.size() &&
                   stack.strides.size() == stack.weights.size(),
               "a pixel stack has two or three convolutions");
}

}  // namespace

Tensor pixel_features(const Tensor& frame, const PixelScale& scale, const PixelStack& stack,
                      Precision precision) {
  check_stack(stack);
  const Tensor none = torch::empty({0});
  const bool has_third = stack.weights.size() > 2;
  return PixelPath::apply(frame, scale.factor, scale.offset, stack.weights[0], stack.biases[0],
                          stack.weights[1], stack.biases[1], has_third ? stack.weights[2] : none,
                          has_third ? stack.biases[2] : none, stack.strides, static_cast<double>(scale.clip),
                          precision);
}

Tensor pixel_features(std::span<const uint8_t* const> rows, at::IntArrayRef sizes, const PixelScale& scale,
                      const PixelStack& stack, Precision precision) {
  check_stack(stack);
  torch::NoGradGuard no_grad;
  std::vector<Tensor> maps;
  const auto all = static_cast<int64_t>(rows.size());
  for (int64_t first = 0; first < all; first += kPixelChunkRows) {
    const int64_t count = std::min(kPixelChunkRows, all - first);
    const int64_t chunk[] = {count, sizes[1], sizes[2], sizes[3]};
    PixelConvolutions& convolutions = PixelConvolutions::of(chunk, stack.weights, stack.strides, precision);
    Tensor x = convolutions.pixels(rows.subspan(static_cast<size_t>(first), static_cast<size_t>(count)),
                                   scale.factor, scale.offset, scale.clip);
    for (size_t layer = 0; layer < stack.weights.size(); ++layer)
      x = convolutions.forward(layer, x, stack.weights[layer], stack.biases[layer]);
    maps.push_back(convolutions.to_features(x));
  }
  return maps.size() == 1 ? maps.front() : at::cat(maps);
}

std::vector<const uint8_t*> rows_of(const Tensor& dense) {
  std::vector<const uint8_t*> rows(static_cast<size_t>(dense.size(0)));
  for (size_t row = 0; row < rows.size(); ++row)
    rows[row] = dense.data_ptr<uint8_t>() + static_cast<int64_t>(row) * dense.stride(0);
  return rows;
}

}  // namespace comrad::policy
