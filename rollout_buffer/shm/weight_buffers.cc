#include "rollout_buffer/shm/weight_buffers.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <cstring>
#include <string>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/shm/region.h"

namespace comrad::shm {
namespace {

constexpr int kReadAttempts = 200;

}  // namespace

WeightBuffers::WeightBuffers(const ArenaShape& shape, Region& region, ControlBlock* control)
    : capacity_bytes_(shape.weights_bytes),
      stride_bytes_(round_up(shape.weights_bytes, kPageBytes)),
      control_(control),
      header_(region.take<WeightsHeader>(1)),
      buffers_(region.take<std::byte>(kWeightBufferCount * stride_bytes_, kPageBytes)) {}

void WeightBuffers::publish(std::span<const std::byte> bytes, PolicyVersion version) const {
  COMRAD_CHECK(static_cast<int64_t>(bytes.size()) <= capacity_bytes_, "the weights fit the arena's buffers");
  const uint32_t current = header_->current.load(std::memory_order_acquire);
  const uint32_t older = current == 1 ? 1 : 0;
  WeightsHeader::Buffer& buffer = header_->buffer[older];
  // A learner killed in this block leaves an odd number and the other buffer current; its successor starts
  // over here.
  const uint64_t writing = (buffer.sequence.load(std::memory_order_relaxed) + 1) | 1;
  buffer.sequence.store(writing, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  if (!bytes.empty()) std::memcpy(buffers_ + older * stride_bytes_, bytes.data(), bytes.size());
  buffer.bytes.store(bytes.size(), std::memory_order_relaxed);
  buffer.checksum.store(checksum64(bytes), std::memory_order_relaxed);
  buffer.version.store(version, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  buffer.sequence.store(writing + 1, std::memory_order_release);
  header_->current.store(older + 1, std::memory_order_release);
  ring(control_->weights_published);
}

PolicyVersion WeightBuffers::version() const {
  const uint32_t current = header_->current.load(std::memory_order_acquire);
  return current == 1 || current == 2 ? header_->buffer[current - 1].version.load(std::memory_order_acquire)
                                      : 0;
}

bool WeightBuffers::has_any() const {
  const uint32_t current = header_->current.load(std::memory_order_acquire);
  return current == 1 || current == 2;
}

Expected<PolicyVersion> WeightBuffers::read(std::vector<std::byte>& out) const {
  for (int attempt = 0; attempt < kReadAttempts; ++attempt) {
    if (attempt > 0) usleep(1000);
    const uint32_t current = header_->current.load(std::memory_order_acquire);
    if (current != 1 && current != 2) return Error{ErrorCode::kNotFound, "weights: none are published yet"};
    const WeightsHeader::Buffer& buffer = header_->buffer[current - 1];
    const uint64_t sequence = buffer.sequence.load(std::memory_order_acquire);
    const uint64_t bytes = buffer.bytes.load(std::memory_order_relaxed);
    if (sequence % 2 != 0 || bytes > static_cast<uint64_t>(capacity_bytes_)) continue;
    const uint64_t checksum = buffer.checksum.load(std::memory_order_relaxed);
    const PolicyVersion version = buffer.version.load(std::memory_order_relaxed);
    out.resize(bytes);
    if (bytes != 0) std::memcpy(out.data(), buffers_ + (current - 1) * stride_bytes_, bytes);
    std::atomic_thread_fence(std::memory_order_acquire);
    if (buffer.sequence.load(std::memory_order_relaxed) == sequence && checksum64(out) == checksum)
      return version;
  }
  return Error{ErrorCode::kBadFormat,
               fmt::format("weights: the checksum of version {} kept failing; the learner must publish again",
                           version())};
}

}  // namespace comrad::shm
