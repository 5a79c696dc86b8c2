#include "policy_workers/device/upload.h"

#include <cstring>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::device {

void copy_aligned(const Tensor& bytes, const std::vector<Tensor>& tensors) {
  int64_t at = 0;
  for (const Tensor& tensor : tensors) {
    tensor.copy_(numbers_at(bytes, at, tensor.numel(), tensor.scalar_type()).view(tensor.sizes()));
    at += aligned(static_cast<int64_t>(tensor.nbytes()));
  }
  COMRAD_CHECK(at == bytes.numel(), "there are as many bytes as the tensors have");
}

void Upload::put(std::span<const std::byte> bytes, const std::vector<Tensor>& tensors) {
  if (tensors.empty()) return;
  const torch::NoGradGuard no_grad;
  const torch::Device device = tensors.front().device();
  int64_t staged = 0;
  for (const Tensor& tensor : tensors) staged += aligned(static_cast<int64_t>(tensor.nbytes()));
  left_.wait();
  if (!staging_.defined() || staging_.numel() != staged) {
    staging_ = host_memory({staged}, torch::kUInt8, device);
    there_ = device.is_cpu() ? staging_ : torch::empty({staged}, staging_.options().device(device));
  }
  auto* to = staging_.data_ptr<uint8_t>();
  std::size_t from = 0;
  for (const Tensor& tensor : tensors) {
    COMRAD_CHECK(from + tensor.nbytes() <= bytes.size(), "there are as many bytes as the tensors have");
    std::memcpy(to, bytes.data() + from, tensor.nbytes());
    from += tensor.nbytes();
    to += aligned(static_cast<int64_t>(tensor.nbytes()));
  }
  COMRAD_CHECK(from == bytes.size(), "there are as many bytes as the tensors have");
  if (!device.is_cpu()) {
    there_.copy_(staging_, /*non_blocking=*/true);
    left_.record(Stream::current(device));
  }
  copy_aligned(there_, tensors);
}

}  // namespace comrad::device
