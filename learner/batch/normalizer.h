// Running mean and variance of the returns, so that the critic predicts numbers of unit scale whatever the
// scenario pays. Stage: update.
#pragma once

#include <torch/types.h>

#include <cstdint>

namespace comrad::learn {

/// Scalar running statistics in double precision. Fresh: mean 0, variance 1, count 1.
///
/// update() merges a batch's mean and unbiased variance into the running pair with the parallel-variance
/// formula (Chan, Golub, LeVeque 1979); normalize() is clip((x - mean) / sigma, +-5), denormalize() is
/// clamp(x, +-5) * sigma + mean, with sigma = sqrt(variance + 1e-5).
class ReturnNormalizer {
 public:
  struct Statistics {
    double mean = 0.0;
    double variance = 1.0;
    double count = 1.0;
  };

  /// Merges the samples of `values` (f32, any shape) where `valid` (u8, same shape; undefined: all) is 1.
  /// A batch without valid samples, or with non-finite ones, changes nothing; false in that case.
  bool update(const torch::Tensor& values, const torch::Tensor& valid);
  torch::Tensor normalize(const torch::Tensor& values) const;
  torch::Tensor denormalize(const torch::Tensor& values) const;

  const Statistics& statistics() const { return statistics_; }
  void restore(const Statistics& statistics) { statistics_ = statistics; }
  double sigma() const;

 private:
  Statistics statistics_;
};

}  // namespace comrad::learn
