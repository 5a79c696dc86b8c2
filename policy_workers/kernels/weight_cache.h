// What is made of a weight for its products (rounded, in panels, in another layout): made once a version of the tensor, not once a product.
#pragma once

#include <c10/util/FunctionRef.h>
#include <torch/types.h>

#include <unordered_map>

namespace comrad::policy {

/// Of one thread. Code that writes a weight past torch's operators calls its bump_version().
class WeightCache {
 public:
  torch::Tensor get(const torch::Tensor& weight, c10::function_ref<torch::Tensor(const torch::Tensor&)> make);

 private:
  struct Made {
    // A weak reference keeps the address from being given to another tensor.
    c10::weak_intrusive_ptr<c10::TensorImpl> weight;
    int64_t version;
    torch::Tensor made;
  };
  std::unordered_map<const c10::TensorImpl*, Made> made_;
};

}  // namespace comrad::policy
