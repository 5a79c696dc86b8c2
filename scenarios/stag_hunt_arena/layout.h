// Draws the map of Stag Hunt Arena: one open square, a stag's spot in its middle, two rings of hares' spots.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::stag_hunt_arena {

constexpr int kInnerSpotCount = 8;

LayoutRecipe recipe();

}  // namespace comrad::scenarios::stag_hunt_arena
