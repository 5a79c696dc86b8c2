// The policy's weights: two buffers, of which the learner fills the one that is not current.
//
//   WeightsHeader | buffer 0, buffer 1 [weights_bytes], each on its own pages
//
// Writer: the learner (on other hosts the trajectory sender). A reader's copy is never torn.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"
#include "rollout_buffer/shm/control_block.h"

namespace comrad::shm {

struct Region;

constexpr int kWeightBufferCount = 2;

/// A sequence lock over two buffers.
struct WeightsHeader {
  struct alignas(kCacheLineBytes) Buffer {
    std::atomic<uint64_t> sequence;  ///< odd while the learner writes into the buffer
    std::atomic<uint64_t> bytes;
    std::atomic<uint64_t> checksum;
    std::atomic<uint32_t> version;
  };
  Buffer buffer[kWeightBufferCount];
  alignas(kCacheLineBytes) std::atomic<uint32_t> current;  ///< 0: nothing yet; else buffer index + 1
};
static_assert(sizeof(WeightsHeader) == 3 * kCacheLineBytes, "changing this bumps kArenaVersion");

class WeightBuffers {
 public:
  WeightBuffers(const ArenaShape& shape, Region& region, ControlBlock* control);

  /// Copies `bytes` into the older buffer, then makes it current as `version`.
  void publish(std::span<const std::byte> bytes, PolicyVersion version) const;
  /// Version that lies ready; 0 before the first publish makes has_any() false.
  PolicyVersion version() const;
  bool has_any() const;
  /// Copies the current weights into `out` (resized) and returns their version; never torn, checksum
  /// verified. Errors: kBadFormat when the checksum keeps failing.
  Expected<PolicyVersion> read(std::vector<std::byte>& out) const;

 private:
  const int64_t capacity_bytes_, stride_bytes_;
  ControlBlock* const control_;
  WeightsHeader* const header_;
  std::byte* const buffers_;
};

}  // namespace comrad::shm
