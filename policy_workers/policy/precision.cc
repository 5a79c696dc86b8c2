#include "policy_workers/policy/precision.h"

#include <unordered_map>

#include "policy_workers/device/queue.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/cpu_features.h"

namespace comrad::policy {

bool multiplies_bf16(torch::Device device) { return !device.is_cpu() || cpu_multiplies_bf16(); }

Tensor factor(const Tensor& x, Precision precision) {
  if (precision == Precision::kFp32) return x;
  const Tensor rounded = x.to(torch::kBFloat16);
  return multiplies_bf16(x.device()) ? rounded : rounded.to(torch::kFloat32);
}

Tensor weight_factor(const Tensor& weight, Precision precision) {
  if (precision == Precision::kFp32 || (at::GradMode::is_enabled() && weight.requires_grad()))
    return factor(weight, precision);
  if (device::is_recording()) return factor(weight.detach(), precision);  // replays round later weights
  struct Rounded {
    // A weak reference keeps the address from being given to another tensor.
    c10::weak_intrusive_ptr<c10::TensorImpl> weight;
    int64_t version;
    Tensor factor;
  };
  constexpr size_t kMostWeights = 64;
  thread_local std::unordered_map<const c10::TensorImpl*, Rounded> rounded;
  const auto version = static_cast<int64_t>(weight._version());
  const auto known = rounded.find(weight.unsafeGetTensorImpl());
  if (known != rounded.end() && known->second.version == version) return known->second.factor;
  if (known == rounded.end() && rounded.size() >= kMostWeights)
    std::erase_if(rounded, [](const auto& entry) { return entry.second.weight.expired(); });
  const Tensor made = factor(weight.detach(), precision);
  rounded.insert_or_assign(
      weight.unsafeGetTensorImpl(),
      Rounded{c10::weak_intrusive_ptr<c10::TensorImpl>(weight.getIntrusivePtr()), version, made});
  return made;
}

Tensor to_f32(const Tensor& product) { return product.to(torch::kFloat32); }

Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias, Precision precision) {
  if (precision == Precision::kFp32) return at::linear(x, weight, bias);
  return to_f32(at::linear(factor(x, precision), weight_factor(weight, precision))) + bias;
}

}  // namespace comrad::policy
