// Draws the map of Co-op Puzzle: two lanes of zones with a grating between them, plates on the floor, a door
// to every even zone.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::coop_puzzle {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::coop_puzzle
