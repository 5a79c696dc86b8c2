// Missiles: how they start, fly, and end. Stage: tic.
#pragma once

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// From `source` towards `target`; null where it exploded at once.
Actor* spawn_missile(World& world, Actor& source, Actor& target, uint32_t type);
Actor* spawn_missile_z(World& world, Actor& source, Fixed z, Actor& target, uint32_t type);
/// From a player along its aim, with the pitch of auto-aim. The offsets are along the axes of the map.
Actor* spawn_player_missile(World& world, Actor& player_body, uint32_t type, Angle angle, Fixed x_offset = 0,
                            Fixed y_offset = 0, Fixed z_offset = 0);
/// Ahead of what launched it, by less than `reach`, its radius; false where it exploded.
bool check_missile_spawn(World& world, Actor& missile, Fixed reach);
void explode_missile(World& world, Actor& missile, Actor* struck);
/// Damage of `dice`, drawn.
int32_t roll_damage(World& world, const DamageDice& dice);

}  // namespace comrad::doom
