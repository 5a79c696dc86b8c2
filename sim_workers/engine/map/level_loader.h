// Makes a Level from the bytes of a map: the one place where indices, sizes and references of a map are
// checked. UDMF (namespaces zdoom and ZDoomTranslated), Hexen's and Doom's format.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/map/level.h"

namespace comrad::doom {

/// Loads the map `name` of `wad`; an empty name takes the WAD's first map. The result is complete
/// (indexed) and may be shared by any number of worlds. What it puts right or leaves out is logged once
/// and stays in Level::warnings. Errors: kNotFound, kUnsupported (another namespace), kBadFormat with the
/// place in the text.
Expected<std::shared_ptr<const Level>> load_level(const wad::WadFile& wad, std::string_view name = {});

/// The same from parsed text, without the lumps of scripts. `label` begins every message.
Expected<std::shared_ptr<const Level>> make_level(const wad::UdmfMap& map, std::string name,
                                                  const std::string& label);

/// Fills what follows from the rest: lines of polyobjects, sector_linedefs and the collision index. For
/// levels made by hand.
void complete_level(Level& level);

}  // namespace comrad::doom
