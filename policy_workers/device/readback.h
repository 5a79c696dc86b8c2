// Numbers on their way from a device to the host. Training requests a readback, continues launching work,
// and looks at the numbers when they are there: once a batch, not once a number. On a CPU they are there at once.
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "policy_workers/device/queue.h"

namespace comrad::device {

/// One tensor's copy on the host.
///
///   Readback loss(numbers);          // the copy begins behind what the device was given so far
///   ...                              // more work for the device
///   if (loss.is_ready()) use(loss.values());   // or wait()
///
/// Threads: one.
class Readback {
 public:
  Readback() = default;
  /// `numbers` f64 [K], of any device.
  explicit Readback(const Tensor& numbers);

  /// Whether the numbers are there, without waiting for them.
  bool is_ready() const;
  /// Waits until they are; counted in host_waits().
  void wait();
  /// [K] on the host; only once they are there.
  const double* values() const;
  int64_t count() const { return host_.numel(); }

 private:
  Tensor host_;  ///< pinned, where the numbers come from a GPU
  Event copied_;
  bool is_slow_ = false;  ///< and was not waited for
};

/// How often this process's host waited for numbers of a device, or would have if the device were not the CPU.
int64_t host_waits();

/// Tests of code that runs ahead of its device: while one of these lives, what comes from a CPU (a Readback, a Snapshot) is there
/// only once it was waited for, as from a busy GPU. Threads: one at a time.
class SlowReadbacks {
 public:
  SlowReadbacks();
  ~SlowReadbacks();
  SlowReadbacks(const SlowReadbacks&) = delete;
  SlowReadbacks& operator=(const SlowReadbacks&) = delete;
};

bool readbacks_are_slow();

}  // namespace comrad::device
