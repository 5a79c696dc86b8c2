// The weights of a learner whose policy workers are threads of its process. They stay on its device: from its network into the older
// of two buffers, and from there into the network of each worker. The weights buffers of the arena are for processes alone.
// Stages: publish, refresh.
#pragma once

#include <torch/types.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

#include "policy_workers/device/queue.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::policy {

/// Tensors are ActorCritic::weight_tensors() of networks alike, on one device.
class LocalWeights {
 public:
  /// Copies `tensors`, behind what their device was given so far. On a CPU it waits while a worker reads the buffer, elsewhere
  /// the device does. Threads: the one that trains.
  void publish(const std::vector<torch::Tensor>& tensors, PolicyVersion version);
  /// What was published last; nothing before the first.
  std::optional<PolicyVersion> version() const;
  /// Copies it into `tensors`, in front of what their device is given next, and returns its version. Threads: any.
  PolicyVersion read(const std::vector<torch::Tensor>& tensors) const;

 private:
  struct Buffer {
    std::mutex mutex;
    torch::Tensor bytes;  ///< u8 [B], each tensor on an aligned place
    PolicyVersion version = 0;
    device::Event written;
    std::vector<device::Event> reads;  ///< since it was written
  };
  mutable std::array<Buffer, 2> buffers_;
  std::atomic<int> current_{0};       ///< buffer that was written last
  std::atomic<int64_t> version_{-1};  ///< in it; -1: nothing was published
};

}  // namespace comrad::policy
