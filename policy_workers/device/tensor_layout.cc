#include "policy_workers/device/tensor_layout.h"

#include "policy_workers/device/torch_ops.h"

namespace comrad::device {

int64_t aligned(int64_t bytes) {
  constexpr int64_t kAlignmentBytes = 64;
  return (bytes + kAlignmentBytes - 1) / kAlignmentBytes * kAlignmentBytes;
}

TensorLayout::TensorLayout(std::span<const Tensor> tensors) {
  for (const Tensor& tensor : tensors) add(tensor.sizes(), tensor.scalar_type());
}

std::size_t TensorLayout::add(at::IntArrayRef sizes, torch::ScalarType type) {
  places_.push_back({.offset = bytes_, .sizes = sizes.vec(), .type = type});
  const int64_t count = c10::multiply_integers(sizes);
  bytes_ = aligned(bytes_ + count * static_cast<int64_t>(c10::elementSize(type)));
  return places_.size() - 1;
}

Tensor TensorLayout::view(const Tensor& memory, std::size_t index) const {
  const Place& place = places_[index];
  const int64_t bytes =
      c10::multiply_integers(place.sizes) * static_cast<int64_t>(c10::elementSize(place.type));
  return memory.narrow(0, place.offset, bytes).view(place.type).view(place.sizes);
}

}  // namespace comrad::device
