#include "policy_workers/kernels/precision.h"

#include <algorithm>
#include <utility>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/packed_product.h"
#include "policy_workers/kernels/weight_cache.h"
#include "rollout_buffer/core/cpu_features.h"

namespace comrad::policy {

namespace {

thread_local KeptFactors* factors_of_thread = nullptr;

}  // namespace

bool multiplies_bf16(torch::Device device) { return !device.is_cpu() || cpu_multiplies_bf16(); }

bool keeps_bf16(torch::Device device, Precision precision) {
  return precision == Precision::kBf16 && multiplies_bf16(device) && !device::has_own_kernels(device);
}

Tensor factor(const Tensor& x, Precision precision) {
  if (precision == Precision::kFp32) return x;
  const Tensor rounded = x.to(torch::kBFloat16);
  return multiplies_bf16(x.device()) ? rounded : rounded.to(torch::kFloat32);
}

Tensor weight_factor(const Tensor& weight, Precision precision) {
  if (precision == Precision::kFp32 || (at::GradMode::is_enabled() && weight.requires_grad()))
    return factor(weight, precision);
  if (factors_of_thread != nullptr) return factors_of_thread->get(weight, precision);
  if (device::is_recording()) return factor(weight.detach(), precision);  // replays round later weights
  thread_local WeightCache rounded;
  return rounded.get(weight, [precision](const Tensor& detached) { return factor(detached, precision); });
}

KeptFactors::Scope::Scope(KeptFactors& kept) : before_(std::exchange(factors_of_thread, &kept)) {}
KeptFactors::Scope::~Scope() { factors_of_thread = before_; }

const Tensor& KeptFactors::get(const Tensor& weight, Precision precision) {
  const auto known = std::ranges::find_if(
      kept_, [&](const Kept& kept) { return kept.weight.is_same(weight) && kept.precision == precision; });
  if (known != kept_.end()) return known->factor;
  return kept_.emplace_back(weight, factor(weight.detach(), precision), weight._version(), precision).factor;
}

void KeptFactors::refresh() {
  const torch::NoGradGuard no_grad;
  for (Kept& kept : kept_) {
    const uint32_t version = kept.weight._version();
    if (version == kept.version) continue;
    kept.factor.copy_(factor(kept.weight, kept.precision));
    kept.version = version;
  }
}

Tensor to_f32(const Tensor& product) { return product.to(torch::kFloat32); }

Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias, Precision precision) {
  if (device::has_own_kernels(x.device()) && !at::GradMode::is_enabled()) {
    const Tensor rows = x.reshape({-1, x.size(-1)});
    if (packs(rows, weight, precision)) {
      Tensor out = torch::empty({rows.size(0), weight.size(0)}, x.options());
      packed_product_out(out, bias, rows, weight, WeightSide::kTransposed, precision);
      std::vector<int64_t> sizes = x.sizes().vec();
      sizes.back() = weight.size(0);
      return out.view(sizes);
    }
  }
  if (precision == Precision::kFp32) return at::linear(x, weight, bias);
  const Tensor rows = factor(x, precision), matrix = weight_factor(weight, precision);
  if (keeps_bf16(x.device(), precision)) return at::linear(rows, matrix, weight_factor(bias, precision));
  return at::linear(rows, matrix) + bias;  // in f32, as the wider
}

}  // namespace comrad::policy
