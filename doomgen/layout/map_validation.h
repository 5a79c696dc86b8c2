// The last check of a map before it is used.
#pragma once

#include "doomgen/layout/map_data.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// What every map of ours keeps: coordinates inside +-16384, no line of length zero, no two lines that cross
/// or lie on each other, no corner nearer than one unit to a foreign line, every sector closed and on the
/// side of each line that names it, every one-sided line facing the void, texture names of 1..8 letters.
/// Errors: kBadInput naming the place.
Status validate_map(const MapData& map);

}  // namespace comrad::doomgen
