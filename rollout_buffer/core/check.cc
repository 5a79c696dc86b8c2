#include "rollout_buffer/core/check.h"

#include <cstdio>
#include <cstdlib>

namespace comrad {

void check_failed(const char* condition, const char* file, int line, std::string_view message) {
  std::fprintf(stderr, "comrad: broken invariant at %s:%d: %.*s (%s)\n", file, line,
               static_cast<int>(message.size()), message.data(), condition);
  std::fflush(stderr);
  std::abort();
}

}  // namespace comrad
