// The policy workers of a run as threads of the process that makes it, its learner, whose GPU they share. Stages: gather > forward >
// scatter.
#pragma once

#include <atomic>
#include <mutex>
#include <thread>
#include <vector>

#include "policy_workers/batching/slab_frames.h"
#include "policy_workers/weights/local_weights.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// One thread for each policy worker of the arena, and on a GPU a stream of high priority for each: while one waits for its answers,
/// another packs. Threads: all functions may be called by any.
class PolicyThreads {
 public:
  /// All outlive it; `frames` may be null.
  PolicyThreads(const RunConfig& config, const shm::Arena& arena, const LocalWeights& weights,
                SlabFrames* frames = nullptr);
  PolicyThreads(const PolicyThreads&) = delete;
  PolicyThreads& operator=(const PolicyThreads&) = delete;
  /// Stops them and waits for their batches.
  ~PolicyThreads();

  /// The first error that ended one. Errors: those of PolicyWorker; kSystem for what a library threw.
  Status check() const;

 private:
  void work(int worker_index);
  Status serve(int worker_index) const;

  const RunConfig& config_;
  const shm::Arena& arena_;
  const LocalWeights& weights_;
  SlabFrames* const frames_;
  std::atomic<bool> stop_{false};
  mutable std::mutex mutex_;
  Status failure_;
  std::vector<std::thread> threads_;
};

}  // namespace comrad::policy
