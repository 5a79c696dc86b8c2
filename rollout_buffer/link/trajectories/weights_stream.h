// The policy's weights on their way to hosts that play for the learner: in half of the bytes with --serve_bf16_weights, in chunks
// of at most 1 MB, put together and checked. Stages: publish, refresh.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::link {

/// `weights` are `parameter_count` f32 parameters and then input statistics, f64, as the learner publishes them; `narrow`
/// becomes half as long: bfloat16, rounded to the nearest and to even at a tie, and then f32. Statistics are not made
/// bfloat16: a mean with three digits would move every input.
/// Errors: kBadFormat where `weights` cannot be these.
Status narrow_weights(std::span<const std::byte> weights, uint64_t parameter_count,
                      std::vector<std::byte>& narrow);

/// The way back: `weights` as the arena has them, with what rounding left. Errors: kBadFormat.
Status widen_weights(std::span<const std::byte> narrow, uint64_t parameter_count,
                     std::vector<std::byte>& weights);

/// Sends all chunks of one version. `bf16_count`: `weights` come from narrow_weights(), with so many parameters; 0: as they
/// lie in an arena. Errors: those of LinkBus::write; the version is to be sent again then.
Status send_weights(dds::LinkBus& bus, std::span<const std::byte> weights, PolicyVersion version,
                    uint64_t bf16_count = 0);

/// One chunk of `weights`, as send_weights sends it. `checksum` is that of all of them.
dds::WeightsChunk weights_chunk(std::span<const std::byte> weights, PolicyVersion version, uint64_t checksum,
                                uint32_t chunk_index, uint64_t bf16_count = 0);

/// Takes chunks in any order, and of two versions at once: the newer one's first chunks overtake the older one's last.
/// Threads: one.
class WeightsAssembler {
 public:
  /// `capacity_bytes` is the size of the arena's weights buffer.
  explicit WeightsAssembler(int64_t capacity_bytes) : capacity_bytes_(capacity_bytes) {}

  /// True once all of a version is there, and its checksum is right.
  /// Errors: kBadFormat for a chunk that cannot be one of weights, or a version whose checksum is wrong.
  Expected<bool> take(const dds::WeightsChunk& chunk);

  // Of the version that take() has just completed; the weights as an arena has them.
  std::span<const std::byte> weights() const { return parts_[0].bf16_count > 0 ? wide_ : parts_[0].weights; }
  PolicyVersion version() const { return parts_[0].version; }

 private:
  struct Part {
    std::vector<std::byte> weights;
    std::vector<bool> has_chunk;
    std::size_t missing = 0;  ///< 0: nothing is awaited
    PolicyVersion version = 0;
    uint64_t checksum = 0;
    uint64_t bf16_count = 0;
  };
  const int64_t capacity_bytes_;
  std::array<Part, 2> parts_;  ///< the one that was begun last comes first
  std::vector<std::byte> wide_;
};

}  // namespace comrad::link
