// How loops over numbers are compiled: for this processor's vectors, chosen when the program starts.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define COMRAD_VECTORISED                                    \
  __attribute__((target_clones("arch=x86-64-v3", "default"), \
                 optimize("O3", "no-trapping-math", "no-math-errno")))
#else
#define COMRAD_VECTORISED
#endif
