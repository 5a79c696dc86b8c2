// Reads what the game counts, by ViZDoom's names. Stage: step.
#pragma once

#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::sim {

/// One variable as `player` sees it. Positions and velocities in map units, angles in degrees (PITCH positive
/// down, below 180), counts since the start of the episode; AMMOn is the ammunition of the weapons in slot n,
/// WEAPONn how many of them are owned; USERk is the raw number that scripts exported. HEALTH is never below 0
/// (ViZDoom's is after a death: read it from the body).
double read_variable(const doom::World& world, int player, const scenarios::GameVariable& variable);

}  // namespace comrad::sim
