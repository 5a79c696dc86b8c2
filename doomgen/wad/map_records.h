// The bytes of a WAD as they lie in the file: header and directory. Little-endian, packed, no pointers.
// Records of binary map lumps (Doom and Hexen formats) join them here; the engine's own types are in
// engine/map/level.h.
#pragma once

#include <array>
#include <cstdint>

namespace comrad::wad {

constexpr std::size_t kLumpNameBytes = 8;

/// The first 12 bytes of a WAD.
struct [[gnu::packed]] WadHeaderRecord {
  std::array<char, 4> magic;  ///< "IWAD" or "PWAD"
  int32_t lump_count;
  int32_t directory_offset_bytes;
};
static_assert(sizeof(WadHeaderRecord) == 12);

/// One line of the directory. A lump of no bytes is a marker.
struct [[gnu::packed]] DirectoryRecord {
  int32_t offset_bytes;
  int32_t size_bytes;
  std::array<char, kLumpNameBytes> name;  ///< padded with zeros, not always terminated
};
static_assert(sizeof(DirectoryRecord) == 16);

}  // namespace comrad::wad
