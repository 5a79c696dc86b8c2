// How the rooms of an arena take their places in the segment, one behind the other. Only the arena and its rooms include
// this header.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::shm {

constexpr int64_t kPageBytes = 4096;

inline int64_t round_up(int64_t value, int64_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

/// Hands out the segment's memory from its base upwards: what a room takes is a function of the shape alone. With the
/// base at null only sizes are computed.
struct Region {
  std::byte* base = nullptr;
  int64_t end_bytes = 0;

  template <typename T>
  T* take(int64_t count, int64_t alignment = kCacheLineBytes) {
    const int64_t start = round_up(end_bytes, std::max<int64_t>(alignment, alignof(T)));
    end_bytes = start + count * static_cast<int64_t>(sizeof(T));
    return reinterpret_cast<T*>(reinterpret_cast<uintptr_t>(base) + static_cast<uintptr_t>(start));
  }
};

/// `rows[index]` of `count`. An index of ours that is out of range is a bug.
template <typename T>
T& element(T* rows, int64_t index, int64_t count, const char* what) {
  COMRAD_CHECK(index >= 0 && index < count, what);
  return rows[index];
}

}  // namespace comrad::shm
