// How a process computes on CPUs: with how many threads, and what becomes of freed memory. Stages: forward, update.
#pragma once

namespace comrad::device {

/// Keeps freed memory in the process, so that the large tensors of every pass reuse mapped pages. First line
/// of main.
void tune_allocator();

/// CPU threads of the calling thread's tensor operators. Cheap enough to be called for every batch.
void set_operator_threads(int thread_count);

/// set_operator_threads(), and those of the matrix products of the whole process.
void set_math_threads(int thread_count);

/// set_math_threads(), which threads that begin later take over, and denormals flushed to zero. Once per thread that
/// computes.
void tune_math(int thread_count);

/// While one lives, set_math_threads(1) holds.
class OneMathThread {
 public:
  OneMathThread();
  ~OneMathThread();
  OneMathThread(const OneMathThread&) = delete;
  OneMathThread& operator=(const OneMathThread&) = delete;

 private:
  int before_;
};

}  // namespace comrad::device
