// What the processor can do. Stage: start-up.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__)
#include <cpuid.h>
#endif

namespace comrad {

struct CpuFeatures {
  bool multiplies_bf16 = false;  ///< bfloat16 numbers (AVX-512 BF16; every processor with AMX has that, too)
  bool has_amx = false;          ///< tiles for bfloat16 products
  int fused_floats = 0;  ///< of one fused multiply-add: 16 (AVX-512), 8 (AVX2 and FMA) or 0: it has neither
};

inline const CpuFeatures& cpu_features() {
  static const CpuFeatures features = [] {
    CpuFeatures found;
#if defined(__x86_64__) && defined(__GNUC__)
    found.multiplies_bf16 = __builtin_cpu_supports("avx512bf16") > 0;
    // Some compilers' __builtin_cpu_supports() lacks the name.
    unsigned a = 0, b = 0, c = 0, d = 0;
    found.has_amx = __get_cpuid_count(7, 0, &a, &b, &c, &d) != 0 && (d & (1u << 22)) != 0;
    if (__builtin_cpu_supports("fma") > 0)
      found.fused_floats = __builtin_cpu_supports("avx512f") > 0 ? 16
                           : __builtin_cpu_supports("avx2") > 0  ? 8
                                                                 : 0;
#endif
    return found;
  }();
  return features;
}

inline bool cpu_multiplies_bf16() { return cpu_features().multiplies_bf16; }

}  // namespace comrad
