// bfloat16 numbers as their bits: the upper half of a float. Stage: beside the flow.
#pragma once

#include <cstdint>

namespace comrad {

// The compiler's own bit cast: kernels for several processors inline no function that may not be inlined always.

[[gnu::always_inline]] inline float widened(uint16_t bits) {
  return __builtin_bit_cast(float, static_cast<uint32_t>(bits) << 16);
}

/// To the nearest even. A NaN as instructions make it stays one; of others rounding may make an infinity or a zero.
[[gnu::always_inline]] inline uint16_t rounded(float value) {
  const uint32_t bits = __builtin_bit_cast(uint32_t, value);
  return static_cast<uint16_t>((bits + 0x7FFFu + ((bits >> 16) & 1u)) >> 16);
}

}  // namespace comrad
