// A stack of convolutions over pixels, each with bias and ELU, on a CPU. By oneDNN itself: activations stay in its layout from layer to
// layer, and bias and ELU are part of the product, where libtorch's convolutions bring every result into plain memory and back. A first
// layer of stride 4 goes over patches of 4 x 4 pixels as over 16 channels each: three channels would leave vectors of 16 or 32 half empty.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <span>

#include "rollout_buffer/settings/words.h"

namespace comrad::policy {

/// Convolutions without padding, of chunks of one size. Numbers are bfloat16 with kBf16 where the processor multiplies them,
/// else f32, whose factors kBf16 rounds. What lies between layers comes as u8 [bytes] in oneDNN's layout. Threads: the one
/// that requested it.
class PixelConvolutions {
 public:
  /// For input [rows, channels, height, width], weights [outputs, inputs, size, size] and a stride each. Made once per thread,
  /// sizes and number of libtorch's threads.
  static PixelConvolutions& of(at::IntArrayRef input, std::span<const torch::Tensor> weights,
                               at::IntArrayRef strides, Precision precision);
  ~PixelConvolutions();

  /// kBFloat16 or kFloat32.
  torch::ScalarType type() const;

  /// The first layer's x of bytes [channels, height, width], `rows` of them anywhere in memory: clamp(byte * factor + offset, -clip, clip),
  /// with factor and offset f32 [channels * height * width].
  torch::Tensor pixels(std::span<const uint8_t* const> rows, const torch::Tensor& factor,
                       const torch::Tensor& offset, float clip);
  /// ELU(conv(x) + bias).
  torch::Tensor forward(std::size_t layer, const torch::Tensor& x, const torch::Tensor& weight,
                        const torch::Tensor& bias);
  struct Gradients {
    torch::Tensor x;             ///< undefined for the first layer
    torch::Tensor weight, bias;  ///< f32 [outputs, inputs, size, size] and [outputs]
  };
  /// By the gradient of y = forward(x), which it changes.
  Gradients backward(std::size_t layer, const torch::Tensor& x, const torch::Tensor& y, torch::Tensor grad,
                     const torch::Tensor& weight);

  /// The last layer's y as plain features [rows, K] of type(), and back: a copy each.
  torch::Tensor to_features(const torch::Tensor& y) const;
  torch::Tensor from_features(const torch::Tensor& features) const;

 private:
  PixelConvolutions();
  struct Layer;
  struct Stack;
  std::unique_ptr<Stack> stack_;
};

}  // namespace comrad::policy
