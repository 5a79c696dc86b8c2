#include "policy_workers/device/upload.h"

#include <cstring>

#include "policy_workers/device/tensor_layout.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::device {

void copy_laid_out(const Tensor& bytes, const std::vector<Tensor>& tensors) {
  const TensorLayout layout(tensors);
  COMRAD_CHECK(layout.bytes() == bytes.numel(), "there are as many bytes as the tensors have");
  for (std::size_t i = 0; i < tensors.size(); ++i) tensors[i].copy_(layout.view(bytes, i));
}

void Upload::put(std::span<const std::byte> bytes, const std::vector<Tensor>& tensors) {
  if (tensors.empty()) return;
  const torch::NoGradGuard no_grad;
  const torch::Device device = tensors.front().device();
  const TensorLayout layout(tensors);
  left_.wait();
  if (!staging_.defined() || staging_.numel() != layout.bytes()) {
    staging_ = host_memory({layout.bytes()}, torch::kUInt8, device);
    there_ = device.is_cpu() ? staging_ : torch::empty({layout.bytes()}, staging_.options().device(device));
  }
  std::size_t from = 0;
  for (std::size_t i = 0; i < tensors.size(); ++i) {
    const std::size_t size = tensors[i].nbytes();
    COMRAD_CHECK(from + size <= bytes.size(), "there are as many bytes as the tensors have");
    std::memcpy(layout.view(staging_, i).data_ptr(), bytes.data() + from, size);
    from += size;
  }
  COMRAD_CHECK(from == bytes.size(), "there are as many bytes as the tensors have");
  if (!device.is_cpu()) {
    there_.copy_(staging_, /*non_blocking=*/true);
    left_.record(Stream::current(device));
  }
  copy_laid_out(there_, tensors);
}

}  // namespace comrad::device
