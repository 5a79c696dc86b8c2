// What sectors do to those who stand on them. Moving floors, doors and line specials will live here too.
// Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/map/level.h"

namespace comrad::doom {

constexpr int32_t kDamageClockTics = 32;     ///< floors hurt whenever the map clock is a multiple of this
constexpr int32_t kDamageEveryTicFrom = 50;  ///< damage of at least this hurts every tic

/// Damage that the floor of `sector` deals at map clock `clock`; 0 in between. An interval given by the map
/// or the script replaces the clock's 32 tics; amounts of 50 and more hurt every tic whatever the interval.
inline int32_t floor_damage_due(const Sector& sector, uint64_t clock) {
  if (sector.damage_amount <= 0) return 0;
  if (sector.damage_amount >= kDamageEveryTicFrom) return sector.damage_amount;
  const auto interval =
      static_cast<uint64_t>(sector.damage_interval > 0 ? sector.damage_interval : kDamageClockTics);
  return clock % interval == 0 ? sector.damage_amount : 0;
}

}  // namespace comrad::doom
