// One number for everything that a world holds: tests and traces compare worlds by it. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// 64-bit hash of the whole state, the same on every machine. Left out is only what the next tic does not read:
/// scratch memory.
uint64_t hash_of(const WorldState& state);

}  // namespace comrad::doom
