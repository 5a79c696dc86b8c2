// Memory of the host that a GPU's kernels read where it lies: what they gather from it crosses once. Serves gather and drain.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <span>

#include "rollout_buffer/core/expected.h"

namespace comrad::device {

using torch::Tensor;

/// Some bytes of this process, within a device's reach while this lives. Move-only.
class MappedMemory {
 public:
  /// `bytes` stay mapped in this process for longer. On a CPU nothing has to be done.
  /// Errors: kSystem where the driver refuses, because a process may lock no more memory, for example.
  static Expected<MappedMemory> create(std::span<std::byte> bytes, torch::Device device);

  MappedMemory(MappedMemory&& other) noexcept;
  MappedMemory& operator=(MappedMemory&& other) noexcept;
  ~MappedMemory();

  /// u8 [B] on the device: the same memory.
  const Tensor& bytes() const { return there_; }

 private:
  MappedMemory() = default;
  void* registered_ = nullptr;  ///< with the driver; null: nothing
  Tensor there_;
};

}  // namespace comrad::device
