// Draws the map of Foraging Commons: a harvest field, a corridor, a cleanup station south of it.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::foraging_commons {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::foraging_commons
