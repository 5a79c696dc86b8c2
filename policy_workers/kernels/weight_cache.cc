#include "policy_workers/kernels/weight_cache.h"

namespace comrad::policy {

torch::Tensor WeightCache::get(const torch::Tensor& weight,
                               c10::function_ref<torch::Tensor(const torch::Tensor&)> make) {
  const auto version = static_cast<int64_t>(weight._version());
  const auto known = made_.find(weight.unsafeGetTensorImpl());
  if (known != made_.end() && known->second.version == version) return known->second.made;
  if (known == made_.end())
    std::erase_if(made_, [](const auto& entry) { return entry.second.weight.expired(); });
  const torch::Tensor made = make(weight.detach());
  made_.insert_or_assign(
      weight.unsafeGetTensorImpl(),
      Made{c10::weak_intrusive_ptr<c10::TensorImpl>(weight.getIntrusivePtr()), version, made});
  return made;
}

}  // namespace comrad::policy
