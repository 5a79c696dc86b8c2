// The bytes behind a replay: anonymous memory, or a file mapped for reading. Writing a file goes through
// pwrite, because a store into a mapped page that is not in memory would first read it from the disk, and
// because a failing disk is then an error instead of a signal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/mapping.h"

namespace comrad::replay {

/// Owns `size_bytes` of memory. Move-only.
class RingMemory {
 public:
  /// Anonymous memory; pages are taken on first touch. Errors: kNoSpace when the host has less free memory
  /// (needed, free, and the flags that help), kSystem.
  static Expected<RingMemory> in_ram(int64_t size_bytes);
  /// A new file of that size, of which all blocks are reserved at once. Its name is removed as soon as it is
  /// open: the space comes back when the process ends, however it ends.
  /// Errors: kBadInput (the name is taken), kNotFound (no such folder), kNoSpace, kSystem.
  static Expected<RingMemory> in_file(const std::string& path, int64_t size_bytes);

  const std::byte* data() const { return mapping_.data; }
  int64_t size_bytes() const { return mapping_.size_bytes; }
  bool is_file() const { return mapping_.descriptor >= 0; }
  int descriptor() const { return mapping_.descriptor; }  ///< -1 where there is no file

  /// Writes the parts one behind the other. Errors: kNoSpace, kSystem (of the disk).
  Status write(int64_t offset, std::span<const std::span<const std::byte>> parts);
  /// Requests these bytes from the kernel ahead of their use; nothing to do in RAM.
  void prefetch(int64_t offset, int64_t byte_count) const;
  /// Syncs a file and lets the kernel forget its pages, so that a measurement begins cold; nothing to do
  /// in RAM.
  void forget_cached() const;

 private:
  RingMemory() = default;
  std::string path_;
  Mapping mapping_;
};

}  // namespace comrad::replay
