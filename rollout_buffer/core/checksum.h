// A fast 64-bit checksum for bytes that travel between processes or outlive one: it finds torn and damaged copies, it
// is no defence against an attacker.
//
// It is XXH3, libxxhash's. Four hashes beside it are other things and stay as they are: FNV-1a of texts (RngKey::split,
// doomgen::content_hash) decides which maps a seed draws and which pool a map belongs to, which is published;
// mix64 and hash_of(WorldState) are the world's identity, field by field; CRC-32C frames TensorBoard's records, and zlib
// and libxxhash have no such function.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace comrad {

/// XXH3_64bits of `bytes`, seed 0: the same on every machine.
uint64_t checksum64(std::span<const std::byte> bytes);

}  // namespace comrad
