// Draws the map of Ammo Carrier: a hub for the defender, depots around it, corridors between them.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::ammo_carrier {

constexpr int kAmmoSpotsPerDepot = 8;
constexpr int kRunnerSpotCount = 10;
constexpr int kHubSpotCount = 4;

LayoutRecipe recipe();

}  // namespace comrad::scenarios::ammo_carrier
