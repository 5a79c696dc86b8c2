// What the families of movers (doors, lifts, floors, ...) share, and where movers.cc finds each of them. For
// the files of this folder alone; movers.h is for the others. Stage: tic.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/world/mover_state.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

// ---- the families: does `call`, or nothing where its number is none of theirs

std::optional<int32_t> execute_door(World& world, const SpecialCall& call);
std::optional<int32_t> execute_plat(World& world, const SpecialCall& call);
std::optional<int32_t> execute_floor(World& world, const SpecialCall& call);
std::optional<int32_t> execute_ceiling(World& world, const SpecialCall& call);
std::optional<int32_t> execute_stairs(World& world, const SpecialCall& call);  ///< pillars and donuts too
std::optional<int32_t> execute_light(World& world, const SpecialCall& call);
std::optional<int32_t> execute_scroller(World& world, const SpecialCall& call);
std::optional<int32_t> execute_polyobject(World& world, const SpecialCall& call);

void start_doors(World& world);  ///< those of sector types
void start_lights(World& world);
void start_scrollers(World& world);
void start_polyobjects(World& world);

void tic_door(World& world, SectorMover& door);
void tic_plat(World& world, SectorMover& plat);
void tic_floor(World& world, SectorMover& floor);  ///< stairs too
void tic_ceiling(World& world, SectorMover& ceiling);
void tic_crusher(World& world, SectorMover& crusher);
void tic_elevator(World& world, SectorMover& elevator);
void tic_pillar(World& world, SectorMover& pillar);
void tic_waggle(World& world, SectorMover& waggle);
void tic_lights(World& world);
void tic_scrollers(World& world, std::size_t first = 0);
void tic_polyobjects(World& world);

// ---- movers

enum PlaneBits : int32_t { kFloorPlane = 1, kCeilingPlane = 2, kBothPlanes = 3 };

inline bool is_busy(const World& world, uint32_t sector, int32_t planes) {
  return (world.state().movers.plane_busy[sector] & planes) != 0;
}
constexpr int32_t planes_of(const SectorMover& mover) {
  switch (mover.kind) {
    case MoverKind::kDoor:
    case MoverKind::kCeiling:
    case MoverKind::kCrusher:
      return kCeilingPlane;
    case MoverKind::kElevator:
    case MoverKind::kPillar:
      return kBothPlanes;
    case MoverKind::kWaggle:
      return mover.type;  // PlaneBits
    default:
      return kFloorPlane;
  }
}
/// Adds `mover` and marks its planes as busy. The reference holds until the end of the tic.
SectorMover& start_mover(World& world, const SectorMover& mover);
void stop_mover(World& world, SectorMover& mover);
/// The mover of a sector's plane; null: it rests.
SectorMover* find_mover(World& world, uint32_t sector, int32_t planes);
bool is_on_lift(const World& world, uint32_t sector);  ///< a lift that goes down first moves its floor

// ---- planes

constexpr Fixed kCrushGap = to_fixed(8);  ///< what most crushers leave
constexpr int32_t kGenericCrush = 20;     ///< damage of the generic specials
constexpr int32_t kTypeMask = 0xFF;       ///< of a sector's special: its type, in ZDoom's numbering

enum class PlaneStep : uint8_t { kMoved, kArrived, kBlocked };

/// Moves a plane by `speed` towards `target`, at most to the other plane of its sector. A crusher
/// (`crush` >= 0) continues through the body it hurts, unless `hexen_crush` (or, of a floor that sinks, always)
/// puts it back.
PlaneStep step_floor(World& world, uint32_t sector, Fixed speed, Fixed target, bool up, int32_t crush = -1,
                     bool hexen_crush = false);
PlaneStep step_ceiling(World& world, uint32_t sector, Fixed speed, Fixed target, bool up, int32_t crush = -1,
                       bool hexen_crush = false);

// ---- arguments

/// Any argument as map units, kept where sums of heights still fit.
constexpr Fixed units(int64_t value) {
  return static_cast<Fixed>(std::clamp<int64_t>(value, -16000, 16000) * kFracUnit);
}
/// Eighths of a unit per tic.
constexpr Fixed speed_of(int32_t arg) {
  return static_cast<Fixed>(std::clamp<int64_t>(arg, 0, 8 * 16000) * (kFracUnit / 8));
}
/// Eighths of a second, as tics.
constexpr int32_t octics(int32_t arg) {
  return static_cast<int32_t>(std::clamp<int64_t>(int64_t{arg} * 35 / 8, 0, INT32_MAX / 2));
}
constexpr int32_t wait_of(int32_t arg) { return std::clamp(arg, 0, INT32_MAX / 2); }
/// Sums of heights, kept inside the number range.
constexpr Fixed height_sum(Fixed a, int64_t b) {
  return static_cast<Fixed>(std::clamp<int64_t>(int64_t{a} + b, INT32_MIN / 2, INT32_MAX / 2));
}
/// 256 to the turn.
constexpr Angle byte_angle(int32_t arg) { return static_cast<Angle>(arg) << 24; }
/// Damage of crush arguments: 0 does not crush.
constexpr int32_t crush_of(int32_t arg) { return arg > 0 ? arg : -1; }
/// crush mode: 0 and 1 Doom's (continues), 2 Hexen's (waits), 3 Doom's.
constexpr bool is_hexen_crush(int32_t mode) { return mode == 2; }

inline bool has_line(const World& world, const SpecialCall& call) {
  return call.line >= 0 && static_cast<std::size_t>(call.line) < world.level().linedefs.size();
}

/// How far a plane moves "by texture": as high as most walls' textures, because the rules of play do not know
/// pictures; warns once.
Fixed texture_height(const World& world, const SpecialCall& call);

/// Calls visit(sector) for the sectors with `tag`; tag 0: the sector behind the calling line. The result of a
/// special: 1 where any visit answered true.
template <typename Visit>
int32_t for_each_target(World& world, const SpecialCall& call, int32_t tag, Visit visit) {
  bool any = false;
  if (tag == 0) {
    if (!has_line(world, call)) return 0;
    const Linedef& line = world.level().linedefs[static_cast<std::size_t>(call.line)];
    if (line.back) any = visit(world.level().sidedefs[*line.back].sector_index);
  } else {
    for_each_tagged_sector(world, tag, [&](uint32_t sector) { any = visit(sector) || any; });
  }
  return any ? 1 : 0;
}

/// The sector in front of the calling line: model of changes. Nothing for scripts.
inline std::optional<uint32_t> front_sector_of(const World& world, const SpecialCall& call) {
  if (!has_line(world, call)) return std::nullopt;
  const Linedef& line = world.level().linedefs[static_cast<std::size_t>(call.line)];
  return world.level().sidedefs[line.front].sector_index;
}

/// What a plane turns into when it arrives, as the change argument of floors and ceilings selects: 1 the texture
/// and no special, 2 the texture, 3 texture and special; + 4 of the neighbour at the target height instead of
/// the calling line's front.
void set_change(const World& world, const SpecialCall& call, SectorMover& mover, int32_t change,
                bool of_ceiling);
/// Applies it.
void finish_change(World& world, const SectorMover& mover, bool of_ceiling);
/// No special and no damage any more.
void clear_special(Sector& sector);
void copy_special(Sector& to, const Sector& from);

/// Lights of `tag` (not 0): the darkest of their surroundings at fraction 0, the brightest at 1 (16.16).
void set_light_part_way(World& world, int32_t tag, Fixed fraction);

}  // namespace comrad::doom
