// A fast 64-bit checksum for bytes that travel between processes: it finds torn and damaged copies of the
// weights, it is no defence against an attacker. The same on every machine of this byte order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace comrad {

/// Four lanes of multiply and rotate over 64-bit words, then mix64 over the lanes and the length.
uint64_t checksum64(std::span<const std::byte> bytes);

}  // namespace comrad
