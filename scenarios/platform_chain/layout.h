// Draws the map of Platform Chain: a serpentine of rising platforms over lava, some bridges, moving panels.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::platform_chain {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::platform_chain
