// Draws the map of Lava Pit: a chain of platforms over lava, sunken bridges between them, plates that
// raise them.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::lava_pit {

constexpr int32_t kLavaTag = 9000, kPlatformTag = 7000, kBridgeTag = 9100, kGreenTag = 9300, kRedTag = 9500;
constexpr int kCandidatesMax = 4;  ///< places of a bridge's plate on one platform
/// A body leaps 225 units at most, edge to edge (diagonal run, its own radius on both ends); no gap
/// is narrower.
constexpr int32_t kGapMin = 240;
constexpr int32_t kBridgeBite = 36;  ///< how far a bridge reaches into either platform

LayoutRecipe recipe();

}  // namespace comrad::scenarios::lava_pit
