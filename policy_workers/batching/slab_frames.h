// Frames of the arena's slabs on the device that acts and trains, where policy workers are threads of the learner: each goes up once,
// when its agent acts, and the learner's batches are made of what is there. Stages: forward, and drain.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "policy_workers/batching/batcher.h"
#include "policy_workers/device/mapped_memory.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// The arena as the device reads it, and a copy of every slab's frames on the device.
///
/// Threads: a policy worker calls what serves forward, for its own environments; the learner's batcher calls copy_slab() for slabs
/// that are sealed, so that no policy worker has them in hand, and releases them once the device has done the copy.
class SlabFrames {
 public:
  /// Bytes that the copies of an arena's slabs take.
  static int64_t bytes_of(const shm::ArenaShape& shape);
  /// Whether they are a quarter of a device's memory or less. Errors: kNoSpace with both numbers and the setting to lower.
  static Status check_room(const shm::ArenaShape& shape, int64_t device_bytes);
  /// The arena outlives it. `keeps_frames` off: frames are read from the arena, and not kept (a replay has its own memory).
  /// Errors: those of check_room(), and of MappedMemory.
  static Expected<std::unique_ptr<SlabFrames>> create(const shm::Arena& arena, torch::Device device,
                                                      bool keeps_frames);

  // Forward.
  /// Where a row's frame lies in the arena, and where its copy goes: indices for take().
  struct Place {
    int64_t from = 0, to = 0;
  };
  Place place_of(const Request& request, int agent) const;
  /// Of a row without a request.
  Place idle_place() const { return {.from = 0, .to = idle_row_}; }
  /// u8 [B, C, H, W]: frames read from the arena and copied to their places. `from` and `to`: i64 [B] on the device. Only launches
  /// work, and can be recorded.
  Tensor take(const Tensor& from, const Tensor& to) const;
  /// The device has done take() for this request.
  void note_taken(const Request& request);

  // Drain.
  /// Launches the copy of a sealed slab's frames into rows [position * N, (position + 1) * N) of `frame`, u8 [T, R, C, H, W] on the
  /// device, zeros from step `length` on: those that are there, else those in the arena (of a rollout that began before this
  /// process, or that another host played).
  void copy_slab(const Tensor& frame, int64_t position, uint32_t slab_index, uint32_t length) const;

 private:
  /// Whose frame is in a place.
  struct Rollout {
    uint32_t env_index = UINT32_MAX;
    uint64_t rollout_index = 0;
    bool operator==(const Rollout&) const = default;
  };
  SlabFrames(const shm::Arena& arena, device::MappedMemory memory, bool keeps_frames);
  Rollout rollout_of(uint32_t slab_index) const;
  int64_t words_to(const void* place) const;

  const shm::Arena& arena_;
  const EnvShape env_;
  const int64_t steps_, slabs_, idle_row_;
  const device::MappedMemory memory_;
  torch::ScalarType word_ = torch::kUInt8;  ///< the largest of which frames are whole multiples
  int64_t words_of_frame_ = 0;
  Tensor words_;               ///< [W]: the arena
  Tensor frames_;              ///< [W - F + 1, F]: what a frame would be that begins at any word
  Tensor copies_;              ///< [T * slabs * N + 1, F], the last one idle; undefined where none are kept
  std::vector<Rollout> held_;  ///< [slabs * T]: whose frames are in copies_
};

}  // namespace comrad::policy
