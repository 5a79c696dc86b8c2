// The bytes of a WAD as they lie in the file: header and directory. Little-endian, packed, no pointers.
// Records of binary map lumps (Doom and Hexen formats) too; the engine's own types are in engine/map/level.h.
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

using NameBytes = std::array<char, kLumpNameBytes>;  ///< of a texture or flat, padded with zeros

constexpr uint16_t kNoSidedef = 0xFFFF;

/// VERTEXES.
struct [[gnu::packed]] VertexRecord {
  int16_t x, y;
};
static_assert(sizeof(VertexRecord) == 4);

/// LINEDEFS of the Doom format.
struct [[gnu::packed]] LinedefRecord {
  uint16_t start, end;
  uint16_t flags, special, tag;
  uint16_t front, back;  ///< kNoSidedef: none
};
static_assert(sizeof(LinedefRecord) == 14);

/// LINEDEFS of the Hexen format.
struct [[gnu::packed]] HexenLinedefRecord {
  uint16_t start, end;
  uint16_t flags;
  uint8_t special;
  std::array<uint8_t, 5> args;
  uint16_t front, back;
};
static_assert(sizeof(HexenLinedefRecord) == 16);

/// SIDEDEFS.
struct [[gnu::packed]] SidedefRecord {
  int16_t offset_x, offset_y;
  NameBytes top, bottom, middle;
  uint16_t sector;
};
static_assert(sizeof(SidedefRecord) == 30);

/// SECTORS.
struct [[gnu::packed]] SectorRecord {
  int16_t floor_height, ceiling_height;
  NameBytes floor_texture, ceiling_texture;
  int16_t light;
  uint16_t special, tag;
};
static_assert(sizeof(SectorRecord) == 26);

/// THINGS of the Doom format.
struct [[gnu::packed]] ThingRecord {
  int16_t x, y, angle, type;
  uint16_t flags;
};
static_assert(sizeof(ThingRecord) == 10);

/// THINGS of the Hexen format.
struct [[gnu::packed]] HexenThingRecord {
  int16_t id, x, y, height, angle, type;
  uint16_t flags;
  uint8_t special;
  std::array<uint8_t, 5> args;
};
static_assert(sizeof(HexenThingRecord) == 20);

}  // namespace comrad::wad
