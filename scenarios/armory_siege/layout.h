// Draws the map of Armory Siege: a hall, three rooms behind doors, three corridors that enemies come through.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::armory_siege {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::armory_siege
