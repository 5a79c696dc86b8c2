// A map from above: sectors shaded by the height of their floors, lines, things. To look at what
// was drawn.
#pragma once

#include <cstdint>
#include <span>

#include "doomgen/layout/picture.h"
#include "doomgen/wad/udmf_reader.h"

namespace comrad::doomgen {

/// What a thing is, and how pictures of maps show it.
struct ThingKind {
  const char* name;
  const char* colour_name;
  Colour colour;
};

/// All kinds, the one for things without another kind last.
std::span<const ThingKind> thing_kinds();
/// The kind of a THINGS editor number: those of Doom II, player starts 5 to 8 (4001 to 4004) and map spots (9001).
const ThingKind& kind_of_thing(int32_t editor_number);

/// Draws a map so that its longer side takes `side` pixels. Floors go from dark (lowest) to light (highest),
/// closed sectors are brown, walls white, two-sided lines grey (blocking ones yellow), things discs of their kind's
/// colour. The picture has less than 256 colours. Errors: kBadInput for a map without vertices or a side outside
/// 16..8192.
Expected<Picture> draw_map(const wad::UdmfMap& map, int side);

}  // namespace comrad::doomgen
