// Threads that work through the parts of one job side by side. The parts of an update are its micro-batches:
// two threads with a micro-batch each keep two cores busier than one micro-batch whose every product is split
// in two, because nobody waits at the end of every product. Stage: update.
#pragma once

#include <torch/types.h>

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// Samples of one micro-batch, as `micro_batch_size` says; 0 stands for what suits the device: a CPU's caches, or a GPU, which is
/// started as often for few samples as for many.
int64_t samples_of_part(const RunConfig& config, torch::Device device);

/// How many micro-batches of a run's learner are computed at a time: learner_threads of them, fewer where
/// their activations would take too much memory. One on a GPU, which is busy with one micro-batch.
int threads_for_parts(const RunConfig& config, torch::Device device);

class PartPool {
 public:
  /// `threads` at work at once, the caller's among them.
  explicit PartPool(int threads);
  ~PartPool();
  PartPool(const PartPool&) = delete;
  PartPool& operator=(const PartPool&) = delete;

  int threads() const { return static_cast<int>(helpers_.size()) + 1; }
  /// Calls work(part) once for every part in [0, parts), in any order and thread; inside, libtorch and its
  /// BLAS compute with one thread. `keep_going` is asked in the caller's thread before each of its parts and
  /// may be empty; once it says no, no further part begins. Returns whether all were done. An exception of a
  /// part ends the job and is thrown again here.
  bool run(int64_t parts, const std::function<void(int64_t)>& work, const std::function<bool()>& keep_going);

 private:
  void help();
  /// Takes parts until none is left; `keep_going` may be empty.
  void take_parts(const std::function<bool()>& keep_going);

  std::vector<std::thread> helpers_;
  std::mutex mutex_;
  std::condition_variable job_begins_, job_ends_;
  // Of the present job, under mutex_.
  const std::function<void(int64_t)>* work_ = nullptr;
  int64_t parts_ = 0, next_ = 0;
  int64_t job_ = 0;  // counts jobs
  int busy_ = 0;     // helpers at work on it
  bool stopped_ = false, closing_ = false;
  std::exception_ptr failure_;
};

}  // namespace comrad::learn
