// The families of specials that are no movers, and what they share. For the files of this folder alone;
// line_specials.h is for the others. Stage: tic.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

// ---- the families: does `call`, or nothing where its number is none of theirs

std::optional<int32_t> execute_thing_special(World& world, const SpecialCall& call);
std::optional<int32_t> execute_teleport_special(World& world, const SpecialCall& call);
std::optional<int32_t> execute_sector_special(World& world, const SpecialCall& call);

// ---- arguments

constexpr int32_t kArgumentMax = 16000;  // units; larger arguments mean no more than this

constexpr Fixed clamped_units(int64_t units) {
  return static_cast<Fixed>(std::clamp<int64_t>(units, -kArgumentMax, kArgumentMax) * kFracUnit);
}
/// 256 to the turn.
constexpr Angle angle_of_byte(int32_t arg) { return static_cast<Angle>(arg) << 24; }
constexpr int32_t negated(int32_t value) { return value == INT32_MIN ? INT32_MAX : -value; }

}  // namespace comrad::doom
