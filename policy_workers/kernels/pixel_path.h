// A stack of two or three convolutions with ELU on a CPU, from bytes to features, with its gradient: normalisation and layers in chunks
// of rows whose activations stay in the caches. Serves forward and update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/settings/words.h"

namespace comrad::policy {

/// Convolutions without padding, each followed by ELU.
struct PixelStack {
  std::vector<torch::Tensor> weights, biases;  ///< [outputs, inputs, size, size], [outputs]
  std::vector<int64_t> strides;
};
/// How many convolutions a PixelStack may have.
constexpr std::size_t kPixelLayersMin = 2, kPixelLayersMax = 3;

/// How bytes become the first layer's input: clamp(byte * factor + offset, -clip, clip), factor and offset f32 [C * H * W].
struct PixelScale {
  torch::Tensor factor, offset;
  float clip = 0;
};

/// Features [B, K] of frames u8 [B, C, H, W] on the CPU, bfloat16 where products are. Differentiable in weights and biases.
torch::Tensor pixel_features(const torch::Tensor& frame, const PixelScale& scale, const PixelStack& stack,
                             Precision precision);

/// The same without a gradient from frames that lie anywhere in memory; `sizes` are [B, C, H, W].
torch::Tensor pixel_features(std::span<const uint8_t* const> rows, at::IntArrayRef sizes,
                             const PixelScale& scale, const PixelStack& stack, Precision precision);

/// Where each row of u8 [B, ...] begins.
std::vector<const uint8_t*> rows_of(const torch::Tensor& dense);

}  // namespace comrad::policy
