// Doom's own numbers of line and sector types, Boom's additions included, in terms of ZDoom's (Hexen's)
// specials: which special with which arguments, and how the line is activated.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "doomgen/wad/udmf_reader.h"

namespace comrad::wad {

/// What a Doom line type means.
struct TranslatedLine {
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  bool uses_tag = false;  ///< acts on what carries its tag: without a tag it does nothing
};

/// Translates the type of a Doom line with this tag; sets the activation flags of `line`. Nothing for types
/// that are not known; type 0 gives special 0.
std::optional<TranslatedLine> translate_doom_line(int32_t type, int32_t tag, UdmfLinedef& line);

/// A Doom sector type, Boom's generalized bits included, as ZDoom's.
int32_t translate_doom_sector(int32_t type);

/// Turns a map of UDMF's namespace "ZDoomTranslated", whose line and sector types are Doom's, into one of "zdoom".
/// A line's first argument is its tag (measured in ViZDoom 1.3.2: its id does not count). Types that are not known
/// do nothing and are a warning of the map.
void translate_doom_map(UdmfMap& map);

}  // namespace comrad::wad
