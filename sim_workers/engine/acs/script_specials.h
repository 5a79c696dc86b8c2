// The line specials that start and stop scripts. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "sim_workers/engine/acs/caller.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom::acs {

/// Does `call`, or nothing where its number is none of these.
std::optional<int32_t> execute_script_special(World& world, const SpecialCall& call);

/// What SetLineSpecial and SetThingSpecial store. A negative number is that of ACS_NamedExecute or one of its kin: it becomes
/// the special's of the same name, and the script's name its number. 0 where no such special exists.
struct StoredSpecial {
  int32_t number = 0;
  std::array<int32_t, 5> args{};
};
StoredSpecial stored_special(const Caller& caller, StoredSpecial special);

}  // namespace comrad::doom::acs
