#include "policy_workers/network/input_normalizer.h"

#include <algorithm>
#include <vector>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/share_out.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/elementwise.h"
#include "policy_workers/kernels/pixel_path.h"

namespace comrad::policy {
namespace {

constexpr double kVarianceFloor = 1e-5;
/// Columns of the frames' statistics that one thread adds up at a time.
constexpr int64_t kColumnsOfAPiece = 2048;
/// Rows that a device sums at a time: 57 MB of frames' squares.
constexpr int64_t kRowsOfASlice = 512;

}  // namespace

Tensor normalize_bytes(const Tensor& rows, const Tensor& factor, const Tensor& offset) {
  const Tensor dense = rows.contiguous();
  const Tensor out = torch::empty({dense.size(0), factor.numel()}, torch::kFloat32);
  kernels::normalize_bytes(rows_of(dense), factor.numel(), factor.data_ptr<float>(), offset.data_ptr<float>(),
                           kInputClip, out.data_ptr<float>());
  return out;
}

InputNormalizer InputNormalizer::create(int64_t element_count, double scale, bool enabled,
                                        torch::Device device) {
  InputNormalizer normalizer;
  normalizer.element_count_ = element_count;
  normalizer.scale_ = scale;
  normalizer.enabled_ = enabled;
  normalizer.device_ = device;
  const auto options = torch::TensorOptions(torch::kFloat64).device(device);
  normalizer.mean_ = torch::zeros({element_count}, options);
  normalizer.variance_ = torch::ones({element_count}, options);
  normalizer.count_ = torch::ones({1}, options);
  normalizer.lowest_ = torch::full({1}, -kInputClip, torch::TensorOptions(device));
  normalizer.highest_ = -normalizer.lowest_;
  normalizer.derive();
  return normalizer;
}

void InputNormalizer::refresh() {
  rows_seen_.reset();  // a policy worker, which never updates, need not wait for it
  derive();
}

void InputNormalizer::derive() {
  if (element_count_ == 0) return;
  Tensor factor, offset;
  if (enabled_) {
    const Tensor sigma = (variance_ + kVarianceFloor).sqrt();
    factor = (1.0 / (sigma * scale_)).to(torch::kFloat32);
    offset = (-mean_ / sigma).to(torch::kFloat32);
  } else {
    factor = torch::full_like(mean_, 1.0 / scale_, torch::kFloat32);
    offset = torch::zeros_like(mean_, torch::kFloat32);
  }
  if (mean_.is_cpu() || !factor_.defined()) {
    factor_ = factor;
    offset_ = offset;
  } else {  // recorded work (device/queue.h) reads them where they are
    factor_.copy_(factor);
    offset_.copy_(offset);
  }
}

Tensor InputNormalizer::normalize(const Tensor& rows, torch::ScalarType type) const {
  if (device::has_own_kernels(rows.device()) && rows.scalar_type() == torch::kUInt8)
    return normalize_bytes(rows, factor_, offset_).to(type);
  if (type == torch::kFloat32) {
    if (!enabled_) return at::mul(rows, factor_);
    return at::addcmul(offset_, rows, factor_).clamp_(-kInputClip, kInputClip);
  }
  Tensor rounded = torch::empty(rows.sizes(), factor_.options().dtype(type));
  if (!enabled_) return at::mul_out(rounded, rows, factor_);
  return at::clamp_out(rounded, at::addcmul(offset_, rows, factor_), lowest_, highest_);
}

void InputNormalizer::normalize_rows(std::span<const uint8_t* const> rows, float* out) const {
  // Without statistics x / 255 lies in [0, 1], so the clip never acts.
  kernels::normalize_bytes(rows, element_count_, factor_.data_ptr<float>(), offset_.data_ptr<float>(),
                           kInputClip, out);
}

void InputNormalizer::update(const Tensor& rows, const AddUp& add_up) {
  if (!enabled_ || (rows.numel() == 0 && !add_up)) return;
  torch::NoGradGuard no_grad;
  const Tensor flat = rows.reshape({-1, element_count_});
  double batch_count = static_cast<double>(flat.size(0));
  Tensor sum, square_sum;
  if (device::has_own_kernels(flat.device()) && flat.scalar_type() == torch::kUInt8) {
    // Bytes are summed as integers: exact, in any order.
    const Tensor dense = flat.contiguous();
    sum = torch::empty({element_count_}, torch::kFloat64);
    square_sum = torch::empty({element_count_}, torch::kFloat64);
    const int64_t pieces = (element_count_ + kColumnsOfAPiece - 1) / kColumnsOfAPiece;
    device::share_out(static_cast<std::size_t>(pieces), [&](std::size_t piece) {
      const int64_t first = static_cast<int64_t>(piece) * kColumnsOfAPiece;
      kernels::sum_bytes(dense.data_ptr<uint8_t>(), dense.size(0), element_count_, first,
                         std::min(first + kColumnsOfAPiece, element_count_), sum.data_ptr<double>(),
                         square_sum.data_ptr<double>());
    });
    sum = sum.to(device_);
    square_sum = square_sum.to(device_);
  } else {
    // In slices: squares of a whole batch of frames would not fit beside the network on a GPU. Those of bytes are summed as integers.
    const bool is_bytes = flat.scalar_type() == torch::kUInt8;
    const auto wide = is_bytes ? torch::kInt32 : torch::kFloat64,
               exact = is_bytes ? torch::kInt64 : torch::kFloat64;
    sum = torch::zeros_like(mean_);
    square_sum = torch::zeros_like(mean_);
    for (int64_t first = 0; first < flat.size(0); first += kRowsOfASlice) {
      const Tensor slice = flat.slice(0, first, first + kRowsOfASlice).to(device_);
      sum.add_(slice.sum(0, /*keepdim=*/false, exact));
      square_sum.add_(slice.to(wide).square().sum(0, /*keepdim=*/false, exact));
    }
  }
  if (add_up) {
    Tensor sums = at::cat({sum, square_sum, torch::full({1}, batch_count, sum.options())});
    add_up(sums);
    sum = sums.narrow(0, 0, element_count_);
    square_sum = sums.narrow(0, element_count_, element_count_);
    batch_count = sums[2 * element_count_].item<double>();
    if (batch_count == 0) return;
  }
  const Tensor batch_mean = sum / batch_count;
  // One row has no unbiased variance; its spread around the running mean still enters through delta below.
  const Tensor batch_spread = (square_sum - sum * batch_mean).clamp_min_(0.0);
  const Tensor batch_variance = batch_spread / std::max(batch_count - 1.0, 1.0);
  const Tensor delta = batch_mean / scale_ - mean_;
  const double old_count = rows_seen_ ? *rows_seen_ : count_.item<double>();
  const double total = old_count + batch_count;
  // Chan, Golub, LeVeque 1979: M2 = var_a n_a + var_b n_b + delta^2 n_a n_b / n.
  const Tensor m2 = variance_ * old_count + batch_variance * (batch_count / (scale_ * scale_)) +
                    delta.square() * (old_count * batch_count / total);
  mean_.add_(delta, batch_count / total);
  variance_.copy_(m2 / total);
  count_.fill_(total);
  rows_seen_ = total;
  derive();
}

NamedTensors InputNormalizer::named_buffers(const std::string& prefix) const {
  if (!enabled_) return {};
  return {{prefix + ".mean", mean_}, {prefix + ".var", variance_}, {prefix + ".count", count_}};
}

std::shared_ptr<ObservationNormalizer> ObservationNormalizer::create(const EnvShape& env, bool enabled,
                                                                     torch::Device device,
                                                                     int64_t global_state_count) {
  auto normalizer = std::make_shared<ObservationNormalizer>();
  normalizer->frame = InputNormalizer::create(env.frame_bytes(), 255.0, enabled, device);
  if (env.measurement_count > 0)
    normalizer->measurement = InputNormalizer::create(env.measurement_count, 1.0, enabled, device);
  if (global_state_count > 0)
    normalizer->global_state = InputNormalizer::create(global_state_count, 1.0, /*enabled=*/true, device);
  return normalizer;
}

void ObservationNormalizer::refresh() {
  torch::NoGradGuard no_grad;
  frame.refresh();
  measurement.refresh();
  global_state.refresh();
}

NamedTensors ObservationNormalizer::named_buffers() const {
  NamedTensors named = frame.named_buffers("normalizer.frame");
  for (auto& entry : measurement.named_buffers("normalizer.measurement")) named.push_back(entry);
  for (auto& entry : global_state.named_buffers("normalizer.global_state")) named.push_back(entry);
  return named;
}

}  // namespace comrad::policy
