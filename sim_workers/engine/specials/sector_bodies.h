// What happens to bodies when the floor or the ceiling of a sector moves: they ride, are pushed up, squeezed,
// crushed. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

enum class PlaneChange : uint8_t { kFloorDown, kFloorUp, kCeilingDown, kCeilingUp };

/// The plane of `sector` has just moved by `distance` (positive). Renews what holds the bodies that touch the
/// sector; those that have no room any more are hurt for `crush` every fourth tic (where >= 0). Corpses
/// become gibs, dropped items vanish. False where a body does not fit.
bool settle_bodies(World& world, uint32_t sector, PlaneChange change, Fixed distance, int32_t crush);

/// True where the body's box touches the sector.
bool touches_sector(const World& world, const Actor& body, uint32_t sector);

}  // namespace comrad::doom
