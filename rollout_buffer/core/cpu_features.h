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

/// Whether it has tiles for bfloat16 products.
inline bool cpu_has_amx() {
#if defined(__x86_64__) && defined(__GNUC__)
  static const bool has_instructions = __builtin_cpu_supports("amx-bf16") > 0;
  return has_instructions;
#else
  return false;
#endif
}

/// Floats that one of its fused multiply-adds takes: 16 (AVX-512), 8 (AVX2 and FMA) or 0 where it has neither.
inline int cpu_fused_floats() {
#if defined(__x86_64__) && defined(__GNUC__)
  static const int floats = __builtin_cpu_supports("fma") <= 0      ? 0
                            : __builtin_cpu_supports("avx512f") > 0 ? 16
                            : __builtin_cpu_supports("avx2") > 0    ? 8
                                                                    : 0;
  return floats;
#else
  return 0;
#endif
}

}  // namespace comrad
