// The maps of one WAD as a pool of WADs with one map each. Stage: loading.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/layout_pool.h"

namespace comrad::scenarios {

/// Writes each map of the WAD at `path` into `folder` (made if need be) as <stem>_<map>.wad, with every lump that is not
/// of another map, and the registry last. An IWAD's art and sounds stay behind: the game has them. The maps belong to
/// neither training nor evaluation. Errors: kBadFormat for a WAD without maps; those of WadFile::open(); kSystem, kNoSpace.
Expected<std::vector<PoolEntry>> split_wad(const std::string& path, const std::string& folder);

}  // namespace comrad::scenarios
