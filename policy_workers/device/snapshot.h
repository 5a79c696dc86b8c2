// Tensors of a device as they are at one moment, on their way to the host as one run of bytes, while the device continues
// and changes them. Serves update > publish.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "policy_workers/device/queue.h"

namespace comrad::device {

/// Its memory is used again by the next take(). Threads: one.
class Snapshot {
 public:
  /// Copies `tensors` of one device, one after another, on the device behind what it was given so far, and from there to
  /// the host beside what it is given next. On a CPU the bytes are there at once. What was taken before must be there.
  void take(const std::vector<Tensor>& tensors);
  /// Whether the bytes are there, without waiting for them.
  bool is_ready() const;
  /// On the host; only once they are there.
  std::span<const std::byte> bytes() const;
  /// Waits for them.
  std::span<const std::byte> wait();

 private:
  Tensor on_device_;  ///< u8 [B]; undefined on a CPU
  Tensor on_host_;    ///< u8 [B]
  std::optional<Stream> copies_;
  Event arrived_;
  bool is_slow_ = false;  ///< and was not waited for
};

}  // namespace comrad::device
