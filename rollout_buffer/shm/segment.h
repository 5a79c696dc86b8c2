// A memfd: anonymous shared memory that is passed by file descriptor, needs no name in /dev/shm and vanishes
// with its last user. Only its sealed size is trusted by those who receive it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::shm {

/// Memory that a new segment may fill: what the kernel calls available, or what is left below the tightest
/// limit of this process's control groups, whichever is less.
int64_t free_memory_bytes();

/// Owns one mapping of a memfd and its descriptor. Move-only.
class Segment {
 public:
  /// Makes `size_bytes` of zeroed shared memory, sealed against resizing.
  /// Errors: kNoSpace when the host has less free memory (needed, free, and the flags that lower it),
  /// kSystem.
  static Expected<Segment> create(const std::string& name, int64_t size_bytes);
  /// Maps a descriptor received from a peer; takes it over. Errors: kBadFormat (not a sealed memfd), kSystem.
  static Expected<Segment> adopt(int descriptor);

  Segment(Segment&& other) noexcept;
  Segment& operator=(Segment&& other) noexcept;
  ~Segment();

  std::byte* data() const { return data_; }
  int64_t size_bytes() const { return size_bytes_; }
  int descriptor() const { return descriptor_; }

 private:
  Segment() = default;
  Status map(int64_t size_bytes);
  std::byte* data_ = nullptr;
  int64_t size_bytes_ = 0;
  int descriptor_ = -1;
};

}  // namespace comrad::shm
