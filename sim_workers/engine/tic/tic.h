// The order of things: how a map starts, and what happens in a tic. Stage: tic.
#pragma once

#include <span>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Starts the map anew: sectors and things as loaded, players at their starts (or 0,0 without one), OPEN
/// and ENTER scripts started; the first tic runs them.
void reset_world(World& world, const WorldOptions& options);

/// One tic, in Doom's order: players think (turn, thrust, jump, eye, weapon, damage of the floor they stand
/// on), then each actor in order of age moves and thinks, then movers, then scripts. `buttons` has one
/// entry per player; missing ones press nothing. After the level was exited nothing moves any more.
void run_tic(World& world, std::span<const Buttons> buttons);

}  // namespace comrad::doom
