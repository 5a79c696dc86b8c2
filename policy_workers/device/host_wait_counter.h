// What makes the host wait for a device, counted through torch's observers on whatever device is at work: on a CPU these
// cost little and can be counted in any test; on a GPU each stops the queue. Serves tests and benches.
#pragma once

#include <ATen/record_function.h>

#include <cstdint>
#include <memory>

namespace comrad::device {

/// Marks an optimizer step, from its first forward pass until the weights have their new values (or the device has its orders
/// for them): in here the host must not wait. Threads: any; may be nested.
class StepScope {
 public:
  StepScope();
  ~StepScope();
  StepScope(const StepScope&) = delete;
  StepScope& operator=(const StepScope&) = delete;
};

/// Counts, in all threads: numbers read out of tensors, positions of what is not zero, comparisons that end in a bool,
/// copies from a device to another, copies of tensors to the host (`.cpu()`), and waits of Readback. One lives at a time.
///
/// A copy to the host is seen on a CPU, too, if the code at work calls its own device "cpu:0": whatever is moved to "cpu"
/// without a number then leaves the device. A tensor that is moved to another's device counts as well: where it has to be
/// copied up, the host waits.
class HostWaitCounter {
 public:
  HostWaitCounter();
  ~HostWaitCounter();
  HostWaitCounter(const HostWaitCounter&) = delete;
  HostWaitCounter& operator=(const HostWaitCounter&) = delete;

  struct Counts {
    int64_t numbers_read = 0, nonzero = 0, device_copies = 0, readbacks = 0;
    int64_t all() const { return numbers_read + nonzero + device_copies + readbacks; }
  };
  /// Within StepScope, and outside.
  Counts in_steps() const;
  Counts between_steps() const;

 private:
  static std::unique_ptr<at::ObserverContext> begin(const at::RecordFunction& function);
  const at::CallbackHandle handle_;
};

/// Called by Readback::wait().
void count_readback();

}  // namespace comrad::device
