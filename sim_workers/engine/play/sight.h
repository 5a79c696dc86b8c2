// Who sees whom. Stage: tic.
#pragma once

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// True where a straight line leads from the eye of `looker` (three quarters up) to some height of `target`:
/// walls, floors and ceilings in between hide. REJECT lumps are not used.
bool can_see(World& world, const Actor& looker, const Actor& target);
/// The same for a monster that looks for someone to attack: what is invisible it notices once in five tries.
bool can_notice(World& world, const Actor& looker, const Actor& target);

/// A noise by `emitter` at its place: monsters in sectors that it reaches hear `target`. It passes openings,
/// and at most one line that blocks sound. `distance_max` 0: as far as it goes. Only who is there now hears
/// it (Actor::last_heard_id); A_Look reacts.
void alert_monsters(World& world, const Actor& target, const Actor& emitter, Fixed distance_max = 0);

}  // namespace comrad::doom
