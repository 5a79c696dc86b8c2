#include "policy_workers/device/snapshot.h"

#include <cstring>

#include "policy_workers/device/readback.h"
#include "policy_workers/device/share_out.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::device {
void Snapshot::take(const std::vector<Tensor>& tensors) {
  COMRAD_CHECK(is_ready(), "one snapshot is on its way at a time");
  const torch::NoGradGuard no_grad;
  int64_t bytes = 0;
  for (const Tensor& tensor : tensors) bytes += static_cast<int64_t>(tensor.nbytes());
  const torch::Device device = tensors.front().device();
  if (!on_host_.defined() || on_host_.numel() != bytes)
    on_host_ = host_memory({bytes}, torch::kUInt8, device);
  is_slow_ = readbacks_are_slow();
  if (device.is_cpu()) {
    std::vector<Tensor> dense;
    std::vector<uint8_t*> to = {on_host_.data_ptr<uint8_t>()};
    for (const Tensor& tensor : tensors) {
      dense.push_back(tensor.contiguous());
      to.push_back(to.back() + tensor.nbytes());
    }
    const std::vector<Piece> pieces = pieces_of(dense);
    share_out(pieces.size(), [&](std::size_t i) {
      const Piece& piece = pieces[i];
      const Tensor& from = dense[piece.tensor];
      const auto size = static_cast<std::size_t>(from.element_size());
      const std::size_t begin = static_cast<std::size_t>(piece.begin) * size;
      std::memcpy(to[piece.tensor] + begin, static_cast<const uint8_t*>(from.data_ptr()) + begin,
                  static_cast<std::size_t>(piece.size()) * size);
    });
    return;
  }
  std::vector<Tensor> parts;
  for (const Tensor& tensor : tensors) parts.push_back(tensor.contiguous().view({-1}).view(torch::kUInt8));
  on_device_ = at::cat(parts);
  if (!copies_) copies_ = Stream::beside(device);
  Event taken;
  taken.record(Stream::current(device));
  copies_->wait_for(taken);
  const StreamScope scope(*copies_);
  on_host_.copy_(on_device_, /*non_blocking=*/true);
  arrived_.record(*copies_);
}

bool Snapshot::is_ready() const { return !is_slow_ && arrived_.is_done(); }

std::span<const std::byte> Snapshot::wait() {
  arrived_.wait();
  is_slow_ = false;
  return bytes();
}

std::span<const std::byte> Snapshot::bytes() const {
  COMRAD_CHECK(is_ready(), "bytes are used once they are there");
  if (!on_host_.defined()) return {};
  return std::as_bytes(std::span(on_host_.data_ptr<uint8_t>(), static_cast<std::size_t>(on_host_.numel())));
}

}  // namespace comrad::device
