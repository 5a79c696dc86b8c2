// The actors that need no DECORATE lump: Doom II's things and the few of ZDoom's own that maps and scripts
// name. Each file holds the tables of one kind. Stage: loading.
#pragma once

#include "sim_workers/engine/actors/actor_catalog.h"

namespace comrad::doom {

void add_builtin_actors(ActorCatalog* catalog);

}  // namespace comrad::doom
