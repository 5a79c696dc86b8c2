// Draws the map of Rhythm Sync: two parallel lanes of equal rooms, a grating between them, a door after
// each stage.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::rhythm_sync {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::rhythm_sync
