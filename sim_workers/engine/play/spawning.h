// What comes into the world: the map's things, players, and what scripts and rules make. Stage: tic.
#pragma once

#include <cstdint>
#include <optional>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Players at their starts, with what they begin with.
void spawn_players(World& world);
/// The map's things, as skill and kind of game require. Those without a picture that touch nothing (map spots,
/// teleport destinations) become no actors unless they have a thing id.
void spawn_map_things(World& world);
/// Takes an actor that leaves without having died or been taken out of the map's totals.
void discount(World& world, const Actor& actor);
/// A tic of a monster's corpse: on the highest skill one that counts as a kill comes back where it was spawned, 12 s after its
/// death at the earliest, with a chance of 5 in 256 at every 32nd tic; not while something stands there.
void respawn_monster(World& world, Actor& corpse);
bool respawn_player(World& world, int player);  ///< at its start; false while something solid stands there
/// Actor id; nothing where it does not fit (and is not forced).
std::optional<uint32_t> spawn_actor(World& world, uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle,
                                    int32_t thing_id = 0, bool force = false);

}  // namespace comrad::doom
