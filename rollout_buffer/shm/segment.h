// A memfd: anonymous shared memory that is passed by file descriptor, needs no name in /dev/shm and vanishes
// with its last user. Receivers trust only its sealed size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/mapping.h"

namespace comrad::shm {

/// Memory that a new segment may fill: what the kernel calls available, or what is left below the tightest
/// limit of this process's control groups, whichever is less.
int64_t free_memory_bytes();

/// Owns one mapping of a memfd and its descriptor. Move-only.
class Segment {
 public:
  /// Makes `size_bytes` of zeroed shared memory, sealed against resizing. Errors: kNoSpace when the host has
  /// less free memory (needed, free, and the flags that lower it), kSystem.
  static Expected<Segment> create(const std::string& name, int64_t size_bytes);
  /// Maps a descriptor received from a peer; takes it over. Errors: kBadFormat (not a sealed memfd), kSystem.
  static Expected<Segment> adopt(int descriptor);

  std::byte* data() const { return mapping_.data; }
  int64_t size_bytes() const { return mapping_.size_bytes; }
  int descriptor() const { return mapping_.descriptor; }

 private:
  Segment() = default;
  Status map(int64_t size_bytes);
  Mapping mapping_;
};

}  // namespace comrad::shm
