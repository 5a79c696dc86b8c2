// Draws the map of Smart Enemies: a round arena full of obstacles, starts in the middle, spots where demons
// come from. Dumb Enemies draws its own with the same hand.
#pragma once

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::smart_enemies {

constexpr int32_t kArenaTag = 1, kFirstSpotId = 9000;
constexpr int kSpotCount = 50;
constexpr double kPelletReach = 500;  // of a hunter's shotgun, units

/// The arena: reads the parameters radius and obstacles.
/// Errors: kBadInput where there is no place for a spot that a demon can leave.
Expected<DrawnLayout> draw_arena(const LayoutDraw& draw);

/// The most kills that a team can have: all demons that come while it can live, were each of them killed as it comes. The floor takes more than the kills bring back where demons come slowly.
double most_kills(const LayoutTask& task);

/// What a hunt requires of its hunters, in numbers of the game.
struct Hunt {
  double radius = 0;         ///< of the arena, units
  double reach = 0;          ///< units from a demon at which a party begins to fire
  double interval_tics = 0;  ///< between two demons
  int cap = 0;               ///< demons that live at a time; at the cap none comes
  int parties = 0;           ///< hunters, or groups of them, each after its own demon
  int guns = 1;              ///< of a party

  /// How long a party is busy with one demon: it walks, turns by 90 degrees and fires. Demons flee until a wall
  /// stops them, and from a place of a disc to one of its edge it is 32 R / 9 pi on average.
  double tics() const;
  /// The share of all demons that is caught. The demons that live are a queue and parties its servers; a demon that
  /// finds `cap` of them does not come: Erlang's M/M/c/K. Both times are taken as exponential.
  double caught_share() const;
};

/// Whether a team can live on such a hunt to the limit, and catches what it catches on the default map, which is
/// `published`. Errors: kBadInput saying what lacks.
Status check_hunt(const LayoutTask& task, const Hunt& hunt, const Hunt& published);

LayoutRecipe recipe();

}  // namespace comrad::scenarios::smart_enemies
