// Makes a Level from the bytes of a map: the one place where indices, sizes and references of a map are
// checked. UDMF (namespace zdoom) so far; binary map formats get their reader in doomgen/wad and their case
// here.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/map/level.h"

namespace comrad::doom {

/// Loads the map `name` of `wad`; an empty name takes the WAD's first map. The result is complete (indexed)
/// and may be shared by any number of worlds. Errors: kNotFound, kUnsupported (another map format),
/// kBadFormat with the place in the text.
Expected<std::shared_ptr<const Level>> load_level(const wad::WadFile& wad, std::string_view name = {});

/// The same from parsed text. `label` begins every message.
Expected<std::shared_ptr<const Level>> make_level(const wad::UdmfMap& map, std::string name,
                                                  const std::string& label);

/// Fills what follows from the rest: sector_linedefs and the collision index. For levels made by hand.
void complete_level(Level& level);

}  // namespace comrad::doom
