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

/// All movers, lights, scrollers and switches, one tic.
void tic_movers(World& world);

/// Lights, scrollers, polyobjects and the like that a map starts with.
void start_movers(World& world);

/// Moves a plane of a sector to `height` if nothing is in the way; crushes for `crush` damage when >= 0.
/// False: blocked (and put back).
bool move_floor(World& world, uint32_t sector, Fixed height, int32_t crush);
bool move_ceiling(World& world, uint32_t sector, Fixed height, int32_t crush);
/// After a plane moved: renews what bodies stand on. False where one does not fit any more.
bool change_sector(World& world, uint32_t sector, int32_t crush);

/// For native rules. A ceiling that goes down to `gap` above its floor and up again for ever, hurting what it
/// meets; false where the ceiling moves already.
bool start_crusher(World& world, uint32_t sector, Fixed down_speed, Fixed up_speed, Fixed gap,
                   int32_t damage);
/// For native rules. Sends a floor to `target` even while it moves (specials leave a busy floor alone).
void send_floor(World& world, uint32_t sector, Fixed target, Fixed speed);

bool sector_is_moving(const World& world, uint32_t sector);     ///< for TagWait
bool polyobject_is_moving(const World& world, int32_t number);  ///< for PolyWait

}  // namespace comrad::doom
