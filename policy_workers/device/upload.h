// Bytes of the host on their way into tensors of a device, which continues with its work meanwhile: the counterpart of
// snapshot.h. Serves refresh.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <span>
#include <vector>

#include "policy_workers/device/queue.h"

namespace comrad::device {

/// Copies `bytes`, u8 [B] on their device, laid out as `tensors` are, into these (tensor_layout.h).
void copy_laid_out(const Tensor& bytes, const std::vector<Tensor>& tensors);

/// Its memory is used again by the next put(). Threads: one.
class Upload {
 public:
  /// Writes `bytes` into `tensors` of one device, one after another, in front of what the device is given next: one copy up
  /// and one on the device for each tensor. The caller's bytes are free at once. Waits only while what was put before is
  /// on its way up. On a CPU the tensors are written at once. The bytes are as many as the tensors have.
  void put(std::span<const std::byte> bytes, const std::vector<Tensor>& tensors);

 private:
  Tensor staging_, there_;  ///< u8 [B], on the host and on the device; on a CPU the same memory
  Event left_;              ///< the host's
};

}  // namespace comrad::device
