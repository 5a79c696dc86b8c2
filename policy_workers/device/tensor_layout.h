// Several tensors in one memory, so that one copy moves them all.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace comrad::device {

using torch::Tensor;

/// The next multiple of a cache line at or behind `bytes`: numbers of any type may lie there.
int64_t aligned(int64_t bytes);

/// Sizes, types and places of tensors that lie one behind the other, each from a cache line on.
class TensorLayout {
 public:
  TensorLayout() = default;
  /// Of tensors like these, in their order.
  explicit TensorLayout(std::span<const Tensor> tensors);

  /// One more; returns its index.
  std::size_t add(at::IntArrayRef sizes, torch::ScalarType type);
  int64_t bytes() const { return bytes_; }
  /// A tensor of `memory`, u8 [bytes()], as a view.
  Tensor view(const Tensor& memory, std::size_t index) const;

 private:
  struct Place {
    int64_t offset;
    std::vector<int64_t> sizes;
    torch::ScalarType type;
  };
  std::vector<Place> places_;
  int64_t bytes_ = 0;
};

}  // namespace comrad::device
