// From slabs of the arena to their places in a batch: frames from where policy threads keep them on the device, or all of it from the
// slab. Stage: drain.
#pragma once

#include <cstdint>
#include <vector>

#include "learner/batch/collate.h"
#include "policy_workers/batching/slab_frames.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

/// A sealed slab and its place in a batch.
struct PlacedSlab {
  uint32_t slab_index = 0;
  int64_t position = 0;
};

/// collate_slab() with each of the slabs; where `frames` is not null, the batch has its frames on `device` alone, and they come from
/// there. The slabs may be released afterwards. Returns the broken decisions. Threads: one at a time for a batch.
int64_t collate_slabs(RolloutBatch& batch, const std::vector<PlacedSlab>& slabs, const shm::Arena& arena,
                      const policy::SlabFrames* frames, torch::Device device);

}  // namespace comrad::learn
