// Threads that work through the parts of one job side by side. The parts of an update are its micro-batches:
// two threads with a micro-batch each keep two cores busier than one micro-batch whose every product is split
// in two, because no thread waits at the end of every product. Those of a policy worker's batch for a GPU are frames
// that are copied. Stages: forward, update.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace comrad::device {

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
  /// may be empty; once it returns false, no further part begins. Returns whether all were done. An exception of a
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

}  // namespace comrad::device
