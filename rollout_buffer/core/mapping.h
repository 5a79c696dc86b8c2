// Memory of the kernel's and the descriptor behind it, given back together. Stage: start-up.
#pragma once

#include <cstddef>
#include <cstdint>

namespace comrad {

/// Owns one mapping, one descriptor, or both. Move-only.
struct Mapping {
  std::byte* data = nullptr;
  int64_t size_bytes = 0;
  int descriptor = -1;  ///< -1: anonymous memory

  Mapping() = default;
  Mapping(Mapping&& other) noexcept;
  Mapping& operator=(Mapping&& other) noexcept;
  ~Mapping();
};

}  // namespace comrad
