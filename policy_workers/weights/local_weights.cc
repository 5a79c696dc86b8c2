#include "policy_workers/weights/local_weights.h"

#include "policy_workers/device/tensor_layout.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/device/upload.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/stage_clock.h"

namespace comrad::policy {

void LocalWeights::publish(const std::vector<torch::Tensor>& tensors, PolicyVersion version) {
  const torch::NoGradGuard no_grad;
  const int older = 1 - current_;
  Buffer& buffer = buffers_[static_cast<std::size_t>(older)];
  const std::lock_guard lock(buffer.mutex);
  const auto bytes = torch::TensorOptions(torch::kUInt8).device(tensors.front().device());
  if (!buffer.bytes.defined()) buffer.bytes = torch::empty({0}, bytes);
  std::vector<torch::Tensor> parts;
  for (const torch::Tensor& tensor : tensors) {
    parts.push_back(tensor.contiguous().view({-1}).view(torch::kUInt8));
    const int64_t count = parts.back().numel();
    if (const int64_t rest = device::aligned(count) - count; rest > 0)
      parts.push_back(torch::empty({rest}, bytes));
    count_copied(tensor.nbytes());
  }
  const device::Stream stream = device::Stream::current(tensors.front().device());
  for (const device::Event& read : buffer.reads) stream.wait_for(read);
  buffer.reads.clear();
  at::cat_out(buffer.bytes, parts);
  buffer.written.record(stream);
  buffer.version = version;
  // Still locked: no version is read before version() returns it.
  current_ = older;
  version_ = version;
}

std::optional<PolicyVersion> LocalWeights::version() const {
  const int64_t version = version_;
  if (version < 0) return std::nullopt;
  return static_cast<PolicyVersion>(version);
}

PolicyVersion LocalWeights::read(const std::vector<torch::Tensor>& tensors) const {
  COMRAD_CHECK(version_ >= 0, "weights are read once there are some");
  const torch::NoGradGuard no_grad;
  Buffer& buffer = buffers_[static_cast<std::size_t>(current_.load())];
  const std::lock_guard lock(buffer.mutex);  // it may hold a newer version by now
  const device::Stream stream = device::Stream::current(tensors.front().device());
  stream.wait_for(buffer.written);
  device::copy_laid_out(buffer.bytes, tensors);
  for (const torch::Tensor& tensor : tensors) count_copied(tensor.nbytes());
  device::Event done;
  done.record(stream);
  buffer.reads.push_back(done);
  return buffer.version;
}

}  // namespace comrad::policy
