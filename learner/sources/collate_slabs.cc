#include "learner/sources/collate_slabs.h"

#include "policy_workers/device/queue.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::learn {

int64_t collate_slabs(RolloutBatch& batch, const std::vector<PlacedSlab>& slabs, const shm::Arena& arena,
                      const policy::SlabFrames* frames, torch::Device device) {
  if (frames != nullptr) {
    const device::Stream copies = device::Stream::beside(device);
    const device::StreamScope scope(copies);
    for (const PlacedSlab& slab : slabs)
      frames->copy_slab(batch.frame_there, slab.position, slab.slab_index,
                        arena.slabs().header(static_cast<int>(slab.slab_index)).length);
    batch.frame_arrived.record(copies);
    batch.is_frame_there = true;
  }
  int64_t broken_count = 0;
  for (const PlacedSlab& slab : slabs) {
    const int index = static_cast<int>(slab.slab_index);
    broken_count +=
        collate_slab(batch, slab.position, arena.slabs().view(index), arena.slabs().header(index).length);
  }
  if (frames != nullptr) batch.frame_arrived.wait();  // else another frame could go where one is read
  return broken_count;
}

}  // namespace comrad::learn
