// Bodies put somewhere at once, instead of moved. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

constexpr int kFogAhead = 20;  ///< units in front of who arrives

/// Moves where the body fits; z follows the floor.
bool try_teleport(World& world, uint32_t actor_id, Fixed x, Fixed y);
void set_position(World& world, uint32_t actor_id, Fixed x, Fixed y, Fixed z);  ///< unchecked
/// Puts the body there, as SetActorPosition and Thing_Move do; false, and it stays, where it does not fit.
bool put_where_it_fits(World& world, Actor& actor, Fixed x, Fixed y, Fixed z);
/// The low-level move of teleporters, with fog and eye; telefrags what stands there when `telefrag`.
bool teleport_move(World& world, Actor& actor, Fixed x, Fixed y, Fixed z, Angle angle, bool fog,
                   bool keep_velocity, bool telefrag);
/// Makes the fog of a teleport, where the catalog contains it.
void spawn_fog(World& world, Fixed x, Fixed y, Fixed z);

}  // namespace comrad::doom
