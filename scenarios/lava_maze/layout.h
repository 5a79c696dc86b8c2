// Draws the map of Lava Maze: a square of cells that rise out of a lava pit, and a gallery around it whose
// four sides have four colours.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::lava_maze {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::lava_maze
