// What the frame link carries, as bytes: requests of simulators (observations and how steps ended) one way, actions the
// other. Both are read as hostile. Stage: commit, scatter.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::link {

/// Beside the kinds of shm::RequestKind: the simulator has sealed this rollout of `step` steps, so its copy is to be sealed.
/// What a simulator left half full is never learned from.
constexpr uint32_t kSealedKind = 3;

/// One environment's request, all N agents, as it travels. The rest of its bytes follow from the shape, the kind and the
/// step: how step - 1 ended (where step > 0), then row `step`, or row `final_row` of the finals; nothing for kSealedKind.
struct FrameRequest {
  uint64_t step_id = 0;
  uint64_t episode_id = 0;
  uint64_t rollout_index = 0;
  uint64_t layout_id = 0;
  uint64_t first_episode_id = 0;
  uint64_t first_episode_seed = 0;
  uint32_t env_index = 0;  ///< of the simulators' host
  uint32_t kind = 0;       ///< shm::RequestKind, or kSealedKind
  uint32_t step = 0;
  uint32_t final_row = 0;
  uint32_t episode_step = 0;
  uint32_t reset_state = 0;
};
static_assert(sizeof(FrameRequest) == 72, "changing this bumps kLinkVersion");

/// The split of an arena, counted over all simulators, to which an environment belongs.
int split_of(const shm::ArenaShape& shape, int env);

/// Bytes of a request and all that follows it.
std::size_t bytes_of(const FrameRequest& request, const SlabOffsets& offsets);
/// The largest.
std::size_t largest_request_bytes(const SlabOffsets& offsets);

/// Puts requests one behind the other. Nothing is allocated once it has had its largest batch.
class FramePacker {
 public:
  explicit FramePacker(const SlabOffsets& offsets) : offsets_(offsets) {}
  void clear() { bytes_.clear(), count_ = 0; }
  void add(const FrameRequest& request, const SlabView& slab);
  std::span<const std::byte> bytes() const { return bytes_; }
  uint32_t count() const { return count_; }

 private:
  const SlabOffsets& offsets_;
  std::vector<std::byte> bytes_;
  uint32_t count_ = 0;
};

/// Takes them apart again: next(), look at the request, then copy_to() or next().
class FrameUnpacker {
 public:
  /// `env_count` environments has the host that sent these.
  FrameUnpacker(const SlabOffsets& offsets, uint32_t env_count, std::span<const std::byte> bytes)
      : offsets_(offsets), env_count_(env_count), left_(bytes) {}

  /// The next request; nothing at the end. Errors: kBadFormat for one that no simulator could have made.
  Expected<std::optional<FrameRequest>> next();
  /// Writes what follows the request of the last next() into a slab. Nothing else of the slab changes.
  void copy_to(const SlabView& slab) const;

 private:
  Status check(std::span<const std::byte> body) const;

  const SlabOffsets& offsets_;
  const uint32_t env_count_;
  std::span<const std::byte> left_, body_;
  FrameRequest request_;
};

/// The answer to one request, and for kAct its choices [N * heads] behind it.
struct FrameAnswer {
  uint64_t step_id = 0;
  uint64_t rollout_index = 0;
  uint32_t env_index = 0;
  uint32_t kind = 0;
  uint32_t step = 0;
  uint32_t is_sealed = 0;  ///< for kSealedKind: 1 where it is sealed here too, 0 where it was not whole
};
static_assert(sizeof(FrameAnswer) == 32, "changing this bumps kLinkVersion");

/// Whether two messages are about the same request.
bool is_same(const auto& a, const auto& b) {
  return a.step_id == b.step_id && a.rollout_index == b.rollout_index && a.kind == b.kind && a.step == b.step;
}

void add_answer(std::vector<std::byte>& bytes, const FrameAnswer& answer, std::span<const int32_t> choices);
/// Takes the first answer off `bytes`; `choices` [N * heads] is filled for kAct. Nothing at the end. Errors: kBadFormat
/// for what is cut, of no kind, or a choice that no head has.
Expected<std::optional<FrameAnswer>> take_answer(std::span<const std::byte>& bytes, const EnvShape& shape,
                                                 std::span<int32_t> choices);

/// Whether LZ4 pays on this link, by trying: it counts what was handed over in windows of each kind and stays with the
/// one that carried more decisions a second; now and then it tries the other one again. Threads: one.
class CompressionChoice {
 public:
  /// Reports that so many decisions came back; `now_s` is any clock's.
  void count(uint64_t decisions, double now_s);
  bool is_compressed() const { return is_compressed_; }
  double rate(bool compressed) const { return rates_[compressed]; }

 private:
  bool is_compressed_ = false;
  bool is_trial_ = true;  ///< of the kind that is not the choice
  bool choice_ = false;
  double began_s_ = -1;
  int windows_ = 0;
  uint64_t decisions_ = 0;
  double rates_[2] = {};
};

/// Counts of microseconds, 8 buckets to a doubling: 12 % wide.
class LatencyCounts {
 public:
  void add(double us);
  double quantile_us(double share) const;  ///< upper end of its bucket; 0 where nothing was counted

 private:
  static constexpr std::size_t kBuckets = 8 * 40;
  uint64_t counts_[kBuckets] = {};
  uint64_t all_ = 0;
};

}  // namespace comrad::link
