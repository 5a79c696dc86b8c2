// Reads maps in the binary formats of Doom and Hexen: THINGS, LINEDEFS, SIDEDEFS, VERTEXES, SECTORS. The
// result is the same as that of a TEXTMAP, with Doom's types translated to ZDoom's numbers. Nodes, blockmap
// and reject lumps are not needed.
#pragma once

#include <string>

#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::wad {

/// True where the map has a BEHAVIOR lump (and no TEXTMAP): the Hexen format.
inline bool is_hexen_format(const MapLumps& lumps) { return !lumps.textmap && lumps.behavior.has_value(); }

/// Reads a binary map. `label` begins every message ("doom2.wad: MAP01"). Line and sector types that are not
/// known become 0 with one warning for all of them. Errors: kBadFormat where a lump is missing or its size is
/// no multiple of its record's.
Expected<UdmfMap> read_binary_map(const WadFile& wad, const MapLumps& lumps, const std::string& label);

}  // namespace comrad::wad
