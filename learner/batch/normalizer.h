// Running mean and variance of the returns, so that the critic predicts numbers of unit scale whatever the
// scenario pays. Stage: update.
#pragma once

#include <torch/types.h>

#include <cstdint>

namespace comrad::learn {

/// Scalar running statistics in double precision. Fresh: mean 0, variance 1, count 1.
///
/// update() merges a batch's mean and unbiased variance into the running pair with the parallel-variance
/// formula (Chan, Golub, LeVeque 1979); normalize() is clamp((x - mean) / sigma, +-clip), denormalize() is
/// clamp(x, +-clip) * sigma + mean, with sigma = sqrt(variance + 1e-5). With a half life the count that came before weighs
/// 2^(-samples / half life) as much at every merge, so that the pair follows returns that grow. A return outside of the clip (a rare
/// jackpot among zeros) looks like one at it, so clipped_fraction() states how many there are.
class ReturnNormalizer {
 public:
  struct Statistics {
    double mean = 0.0;
    double variance = 1.0;
    double count = 1.0;
  };

  /// `clip` in deviations; 0: none. `half_life` in samples; 0: all samples weigh the same for ever.
  explicit ReturnNormalizer(double clip = 5.0, double half_life = 0) : clip_(clip), half_life_(half_life) {}

  /// Merges the samples of `values` (f32, any shape) where `valid` (u8, same shape; undefined: all) is 1.
  /// A batch without valid samples, or with non-finite ones, changes nothing; false in that case.
  bool update(const torch::Tensor& values, const torch::Tensor& valid);
  torch::Tensor normalize(const torch::Tensor& values) const;
  torch::Tensor denormalize(const torch::Tensor& values) const;
  /// Share of the samples of `values` where `valid` is 1 (as in update()) that normalize() clips; 0 without any.
  double clipped_fraction(const torch::Tensor& values, const torch::Tensor& valid) const;

  const Statistics& statistics() const { return statistics_; }
  void restore(const Statistics& statistics) { statistics_ = statistics; }
  double sigma() const;

 private:
  torch::Tensor clipped(const torch::Tensor& deviations) const;

  double clip_, half_life_;
  Statistics statistics_;
};

}  // namespace comrad::learn
