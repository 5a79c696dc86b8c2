// Sums over the samples of a batch that count, straight from host memory: no operator, no wait, no copy of what counts.
// Stage: update, beside the loss.
#pragma once

#include <torch/types.h>

#include <cstdint>

namespace comrad::learn {

using torch::Tensor;

/// How many bytes of `mask` (u8 on the host, any shape) are not 0.
int64_t count_of(const Tensor& mask);

/// The positions of the bytes that are not 0, i64 [count], of the mask as one row.
Tensor positions_of(const Tensor& mask);

/// Of the samples that count, in double.
struct Spread {
  int64_t count = 0;
  double mean = 0, min = 0, max = 0;
  double squares = 0;  ///< sum of (x - mean)^2
  /// With `unbiased` by count - 1; 0 of a single sample.
  double variance(bool unbiased) const;
};
/// `samples` f32, f64 or i64 on the host, [T, R] or [T, R, K]; `mask` u8 [T, R].
Spread spread_of(const Tensor& samples, const Tensor& mask);

}  // namespace comrad::learn
