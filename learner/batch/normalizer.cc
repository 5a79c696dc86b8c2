#include "learner/batch/normalizer.h"

#include <cmath>

#include "learner/batch/masked.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

constexpr double kVarianceFloor = 1e-5;

}  // namespace

double ReturnNormalizer::sigma() const { return std::sqrt(statistics_.variance + kVarianceFloor); }

bool ReturnNormalizer::update(const torch::Tensor& values, const torch::Tensor& valid) {
  const torch::Tensor flat = values.detach().to(torch::kFloat64).contiguous().view({-1});
  const torch::Tensor mask =
      valid.defined() ? valid.to(torch::kUInt8).contiguous().view({-1}) : torch::Tensor();
  COMRAD_CHECK(!mask.defined() || mask.numel() == flat.numel(), "validity has the shape of the values");
  const double* x = flat.data_ptr<double>();
  const uint8_t* v = mask.defined() ? mask.data_ptr<uint8_t>() : nullptr;
  double count = 0, sum = 0;
  for (int64_t i = 0; i < flat.numel(); ++i) {
    if (v != nullptr && v[i] == 0) continue;
    sum += x[i];
    count += 1;
  }
  if (count == 0 || !std::isfinite(sum)) return false;
  const double batch_mean = sum / count;
  double squares = 0;
  for (int64_t i = 0; i < flat.numel(); ++i) {
    if (v != nullptr && v[i] == 0) continue;
    squares += (x[i] - batch_mean) * (x[i] - batch_mean);
  }
  if (!std::isfinite(squares)) return false;
  const double batch_variance = count > 1 ? squares / (count - 1) : 0.0;  // unbiased, as the input statistics

  if (half_life_ > 0) statistics_.count *= std::exp2(-count / half_life_);
  const double delta = batch_mean - statistics_.mean, total = statistics_.count + count;
  const double merged_squares = statistics_.variance * statistics_.count + batch_variance * count +
                                delta * delta * statistics_.count * count / total;
  statistics_.mean += delta * count / total;
  statistics_.variance = merged_squares / total;
  statistics_.count = total;
  return true;
}

torch::Tensor ReturnNormalizer::normalize(const torch::Tensor& values) const {
  return clipped((values - statistics_.mean) / sigma());
}

torch::Tensor ReturnNormalizer::denormalize(const torch::Tensor& values) const {
  return clipped(values) * sigma() + statistics_.mean;
}

torch::Tensor ReturnNormalizer::clipped(const torch::Tensor& deviations) const {
  return clip_ > 0 ? deviations.clamp(-clip_, clip_) : deviations;
}

double ReturnNormalizer::clipped_fraction(const torch::Tensor& values, const torch::Tensor& valid) const {
  if (!(clip_ > 0)) return 0;
  const torch::Tensor counted =
      valid.defined() ? valid.to(torch::kUInt8) : torch::ones_like(values, torch::kUInt8);
  const torch::Tensor outside = ((values - statistics_.mean) / sigma()).abs().gt(clip_).to(torch::kUInt8);
  const int64_t count = count_of(counted);
  return count == 0 ? 0 : static_cast<double>(count_of(outside * counted.ne(0))) / static_cast<double>(count);
}

}  // namespace comrad::learn
