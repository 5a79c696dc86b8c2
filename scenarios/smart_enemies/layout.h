// Draws the map of Smart Enemies: a round arena full of obstacles, starts in the middle, spots where demons
// come from. Dumb Enemies draws its own with the same hand.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::smart_enemies {

constexpr int32_t kArenaTag = 1, kFirstSpotId = 9000;
constexpr int kSpotCount = 50;

/// The arena: reads the parameters radius and obstacles.
/// Errors: kBadInput where there is no place for a spot that a demon can leave.
Expected<DrawnLayout> draw_arena(const LayoutDraw& draw);

/// The most kills that an agent can have on average: of all demons that come while the team can live, were
/// each of them killed as it comes. The floor takes more than the kills bring back where demons come slowly.
double most_kills(const LayoutTask& task);

LayoutRecipe recipe();

}  // namespace comrad::scenarios::smart_enemies
