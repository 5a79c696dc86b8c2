// Actors enter states, which act. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Enters a state and runs its action, then those of states of no tics. False when the actor was removed
/// by it.
bool set_state(World& world, Actor& actor, uint32_t state);
/// False where the type has no such label, or the actor is gone.
bool set_label(World& world, Actor& actor, StateLabel label);

}  // namespace comrad::doom
