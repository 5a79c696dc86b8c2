// Doors, lifts, floors, ceilings, crushers, stairs, lights, scrollers and polyobjects: how each starts and
// moves. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// The specials that move sectors, lights, textures and polyobjects. Nothing where `call.number` is none
/// of them.
std::optional<int32_t> execute_mover_special(World& world, const SpecialCall& call);

/// Floors that carry push what stands on them, before it moves.
void carry_bodies(World& world);

/// One tic of lights, scrollers and switches, and of the planes' first `count` movers. Returns where those that began
/// after them are now.
std::size_t tic_movers(World& world, std::size_t count = SIZE_MAX);
/// The first tic of the planes' movers and of the scrollers from these on, which began in this tic: after the scripts, as in
/// ViZDoom.
void tic_new_movers(World& world, std::size_t first, std::size_t first_scroller);

/// Lights, scrollers, polyobjects and the like that a map starts with.
void start_movers(World& world);

/// After a plane moved: renews what bodies stand on. False where one does not fit any more.
bool change_sector(World& world, uint32_t sector, int32_t crush);

bool sector_is_moving(const World& world, uint32_t sector);     ///< for TagWait
bool polyobject_is_moving(const World& world, int32_t number);  ///< for PolyWait

}  // namespace comrad::doom
