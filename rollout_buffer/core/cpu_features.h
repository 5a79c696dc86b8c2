// What the processor can do. Stage: start-up.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__)
#include <cpuid.h>
#endif

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
  // Not every compiler's __builtin_cpu_supports() knows the name.
  static const bool has_instructions = [] {
    unsigned a = 0, b = 0, c = 0, d = 0;
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) != 0 && (d & (1u << 22)) != 0;
  }();
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
