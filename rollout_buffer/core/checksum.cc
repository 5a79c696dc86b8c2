#include "rollout_buffer/core/checksum.h"

#include <xxhash.h>

namespace comrad {

uint64_t checksum64(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

}  // namespace comrad
