// The line specials that start and stop scripts. Stage: tic.
#pragma once

#include <cstdint>
#include <optional>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom::acs {

/// Does `call`, or nothing where its number is none of these.
std::optional<int32_t> execute_script_special(World& world, const SpecialCall& call);

}  // namespace comrad::doom::acs
