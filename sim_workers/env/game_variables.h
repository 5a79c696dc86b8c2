// Reads what the game counts, by ViZDoom's names. Stage: step.
#pragma once

#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/play/world.h"

namespace comrad::sim {

/// One variable as `player` sees it. Positions and velocities in map units, angles in degrees, health never
/// below 0; USERk is the raw number that the rules exported.
double read_variable(const doom::World& world, int player, const scenarios::GameVariable& variable);

}  // namespace comrad::sim
