// Draws the map of Dumb Enemies: the arena of Smart Enemies, wider.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::dumb_enemies {

LayoutRecipe recipe();

}  // namespace comrad::scenarios::dumb_enemies
