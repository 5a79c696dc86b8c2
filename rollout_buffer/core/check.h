// Broken invariants of our own: print what must hold, where, and abort. Input from outside never trips these.
#pragma once

#include <string_view>

namespace comrad {

/// Prints `condition`, the source position and `message` to stderr and aborts the process.
[[noreturn]] void check_failed(const char* condition, const char* file, int line, std::string_view message);

}  // namespace comrad

#define COMRAD_CHECK(condition, message)                                 \
  do {                                                                   \
    if (!(condition)) [[unlikely]]                                       \
      ::comrad::check_failed(#condition, __FILE__, __LINE__, (message)); \
  } while (false)

#ifdef NDEBUG
#define COMRAD_DCHECK(condition, message) \
  do {                                    \
    (void)sizeof((condition) ? 1 : 0);    \
  } while (false)
#else
#define COMRAD_DCHECK(condition, message) COMRAD_CHECK(condition, message)
#endif
