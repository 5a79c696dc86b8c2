// What a file held when it was played, in a few letters, for records.
#pragma once

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// "xxh3:" and the 16 hexadecimal digits that `xxhsum -H3 FILE` prints. Errors: kNotFound where it cannot be read.
Expected<std::string> content_hash(const std::string& path);

}  // namespace comrad::deploy
