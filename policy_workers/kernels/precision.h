// In which numbers convolutions and matrix products are computed. Weights, their gradients, states and all of the losses stay f32, as
// under autocast; heads and central critics are f32 as well, because ratios of probabilities are made from them. Serves forward and
// update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "rollout_buffer/settings/words.h"

namespace comrad::policy {

using torch::Tensor;

// Precision (rollout_buffer/settings/words.h): kBf16 rounds both factors of a product to bfloat16 (8 bits of mantissa) and sums in f32. Where the machine
// has such instructions (CUDA, AVX-512 BF16, AMX) the product itself is a bfloat16 one; elsewhere f32
// instructions multiply the rounded factors, which gives the same numbers and no speed.

/// Whether `device` multiplies bfloat16 numbers itself.
bool multiplies_bf16(torch::Device device);
/// Whether a layer's result stays bfloat16 until something needs f32: on a GPU, where each conversion is a kernel. Our own kernels of a
/// CPU add bias and activation in f32.
bool keeps_bf16(torch::Device device, Precision precision);

/// `x` as a factor of a product; the product's result goes through to_f32. Differentiable.
Tensor factor(const Tensor& x, Precision precision);
Tensor to_f32(const Tensor& product);

/// factor() of a weight that is read often between two changes: outside of autograd it is rounded once a version of the
/// tensor and thread, not once a product (weight_cache.h). Work that is recorded rounds it each time, unless KeptFactors are there.
Tensor weight_factor(const Tensor& weight, Precision precision);

/// Rounded weights that recorded work reads where they are. Threads: one.
class KeptFactors {
 public:
  /// While one lives, weight_factor() of this thread reads from `kept`. What is not there yet is made: run the work once before it is
  /// recorded.
  class Scope {
   public:
    explicit Scope(KeptFactors& kept);
    ~Scope();
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    KeptFactors* before_;
  };
  const Tensor& get(const Tensor& weight, Precision precision);
  /// Rounds those that have changed since; before each replay.
  void refresh();

 private:
  struct Kept {
    Tensor weight, factor;
    uint32_t version;
    Precision precision;
  };
  std::vector<Kept> kept_;
};

/// x W^T + b in the given precision; f32, except where keeps_bf16(). Differentiable.
Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias, Precision precision);

}  // namespace comrad::policy
