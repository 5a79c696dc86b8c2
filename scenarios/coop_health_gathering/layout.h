// Draws the map of Co-op Health Gathering: a star-shaped arena full of pillars, starts close together, spots
// for kits.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "doomgen/layout/map_data.h"
#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::coop_health_gathering {

constexpr int32_t kArenaTag = 900;
constexpr int kKitSpotCount = 300;

/// Parameter names, defaults and ranges; script.acs reads tether, damage and kit_cap.
std::vector<LayoutParameter> parameters();

/// One attempt: arena, pillars, starts and kit spots, checked for clearance and reachability.
/// Errors: kBadInput when the seed draws a map that fails a check.  Threads: pure function.
Expected<DrawnLayout> draw(uint64_t seed, const std::map<std::string, int64_t>& values);

LayoutRecipe recipe();

}  // namespace comrad::scenarios::coop_health_gathering
