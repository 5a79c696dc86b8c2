// What the processor can do. Stage: start-up.
#pragma once

namespace comrad {

/// Whether it multiplies bfloat16 numbers (AVX-512 BF16; every processor with AMX has that, too).
inline bool cpu_multiplies_bf16() {
#if defined(__x86_64__) && defined(__GNUC__)
  static const bool has_instructions = __builtin_cpu_supports("avx512bf16") > 0;
  return has_instructions;
#else
  return false;
#endif
}

}  // namespace comrad
