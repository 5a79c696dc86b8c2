// A map from above: sectors shaded by the height of their floors, lines, things. For people who look at what
// was drawn.
#pragma once

#include "doomgen/layout/picture.h"
#include "doomgen/wad/udmf_reader.h"

namespace comrad::doomgen {

/// Draws a map so that its longer side takes `side` pixels. Floors go from dark (lowest) to light (highest);
/// walls are white, two-sided lines grey (blocking ones yellow), player starts green, map spots blue,
/// monsters and other things red. Errors: kBadInput for a map without vertices or a side outside 16..8192.
Expected<Picture> draw_map(const wad::UdmfMap& map, int side);

}  // namespace comrad::doomgen
