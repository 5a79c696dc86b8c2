// From a scenario's rules, which know nothing of the engine, to what the engine is told. Stage: reset.
#pragma once

#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::sim {

/// Options of a world with these rules. Players without a start of their own begin at one for deathmatch; number of
/// players, seed, crosshair and respawn are left to the caller.
doom::WorldOptions world_options(const scenarios::GameRules& rules);

/// Runs the tics that pass before the first decision of an episode that was reset just now; nobody presses anything.
void run_start_tics(doom::World& world, const scenarios::GameRules& rules);

}  // namespace comrad::sim
