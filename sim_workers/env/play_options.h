// From a scenario's rules, which are independent of the engine, to the engine's options. Stage: reset.
#pragma once

#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::sim {

/// Options of a world with these rules. Players without their own start begin at one for deathmatch; number of
/// players, seed, crosshair and respawn are left to the caller.
doom::WorldOptions world_options(const scenarios::GameRules& rules);

/// Runs the tics that pass before the first decision of an episode that was reset just now; no button is pressed.
void run_start_tics(doom::World& world, const scenarios::GameRules& rules);

}  // namespace comrad::sim
