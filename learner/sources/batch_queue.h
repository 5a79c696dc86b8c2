// The batcher: a thread that copies sealed slabs into training batches while the learner trains, and
// gives each slab back the moment it is copied. At most `capacity` full batches wait; then slabs stay
// sealed, simulators run out of free ones, and policy lag stays bounded. Stage: drain > sample.
// (Asynchronous mode only.)
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "learner/batch/collate.h"
#include "policy_workers/batching/slab_frames.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

class BatchQueue {
 public:
  /// Starts the thread. `arena` and `frames` outlive the queue. `slabs_per_batch` slabs make a batch, whose frames are sent to
  /// `device` as soon as it is full, or are there already, in `frames`, which may be null.
  BatchQueue(const shm::Arena& arena, int64_t slabs_per_batch, int64_t capacity,
             torch::Device device = torch::kCPU, const policy::SlabFrames* frames = nullptr);
  /// Stops the thread; slabs in the hands of the batcher go back, batches that wait are lost.
  ~BatchQueue();
  BatchQueue(const BatchQueue&) = delete;
  BatchQueue& operator=(const BatchQueue&) = delete;

  /// The oldest full batch, or null after `timeout_ms`.
  std::unique_ptr<RolloutBatch> pop(int timeout_ms);
  /// Hands a trained batch back for reuse.
  void recycle(std::unique_ptr<RolloutBatch> batch);

  int waiting() const;                                          ///< full batches
  uint64_t broken_decisions() const { return broken_.load(); }  ///< that collate found damaged
  /// What stopped the thread early (libtorch out of memory); empty while all is well.
  std::string failure() const;

 private:
  void run();
  void fill();
  bool collect(RolloutBatch& batch);

  const shm::Arena& arena_;
  const int64_t slabs_per_batch_;
  const int64_t capacity_;
  const torch::Device device_;
  const policy::SlabFrames* const frames_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::unique_ptr<RolloutBatch>> full_;
  std::vector<std::unique_ptr<RolloutBatch>> free_;
  std::string failure_;
  std::atomic<uint64_t> broken_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace comrad::learn
