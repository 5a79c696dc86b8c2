// Prints a map in Hexen's binary format, for tools and engines that do not read UDMF. Line ids travel in
// Line_SetIdentification, as the format requires.
#pragma once

#include <string>
#include <vector>

#include "doomgen/layout/map_data.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// The binary lumps of a map, and what the format had no place for, a line each.
struct HexenLumps {
  std::string things, linedefs, sidedefs, vertexes, sectors;
  std::vector<std::string> warnings;
};

/// Errors: kUnsupported naming the line, thing or sector whose numbers do not fit into the format's fields,
/// or the line that has both a special and an id. Source: the Hexen map format as the Doom wiki describes it;
/// records in doomgen/wad/map_records.h.
Expected<HexenLumps> write_hexen(const MapData& map);

}  // namespace comrad::doomgen
