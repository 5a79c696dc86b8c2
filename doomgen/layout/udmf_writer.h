// Prints a map as UDMF text (namespace zdoom): what ViZDoom and our own engine read.
#pragma once

#include <string>

#include "doomgen/layout/map_data.h"

namespace comrad::doomgen {

/// The TEXTMAP lump of a map. Fields with UDMF's default value are left out.
/// Source: UDMF specification 1.1 and the ZDoom extensions 1.21.
std::string write_udmf(const MapData& map);

}  // namespace comrad::doomgen
