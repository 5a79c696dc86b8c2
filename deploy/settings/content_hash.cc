#include "deploy/settings/content_hash.h"

#include <cinttypes>
#include <cstdio>
#include <optional>
#include <span>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {

Expected<std::string> content_hash(const std::string& path) {
  const std::optional<std::string> bytes = read_file(path);
  if (!bytes) return Error{ErrorCode::kNotFound, path + ": cannot be read"};
  char text[32];
  std::snprintf(text, sizeof text, "xxh3:%016" PRIx64, checksum64(std::as_bytes(std::span(*bytes))));
  return std::string(text);
}

}  // namespace comrad::deploy
