#include "sim_workers/engine/specials/movers.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "doomgen/wad/special_names.h"
#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/sector_bodies.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

constexpr std::size_t kSpareMovers = 64;  // so that the step path rarely grows

/// Puts a plane at `height` and settles the bodies; blocked: puts it back where `restores`.
template <bool kFloor>
bool place_plane(World& world, uint32_t index, Fixed height, int32_t crush, bool restores) {
  Fixed Sector::*const plane = kFloor ? &Sector::floor_height : &Sector::ceiling_height;
  const Fixed old_height = world.state().sectors[index].*plane;
  const bool up = height > old_height;
  const auto distance = static_cast<Fixed>(
      std::min<int64_t>(std::abs(int64_t{height} - old_height), std::numeric_limits<Fixed>::max()));
  const auto change = [](bool rises) {
    return kFloor ? (rises ? PlaneChange::kFloorUp : PlaneChange::kFloorDown)
                  : (rises ? PlaneChange::kCeilingUp : PlaneChange::kCeilingDown);
  };
  world.state().sectors[index].*plane = height;
  if (settle_bodies(world, index, change(up), distance, crush)) return true;
  if (restores) {
    world.state().sectors[index].*plane = old_height;
    settle_bodies(world, index, change(!up), distance, -1);
  }
  return false;
}

template <bool kFloor>
PlaneStep step_plane(World& world, uint32_t index, Fixed speed, Fixed target, bool up, int32_t crush,
                     bool hexen_crush) {
  const Sector& sector = world.sectors()[index];
  // Floor and ceiling do not pass through each other.
  if (kFloor && up) target = std::min(target, std::max(sector.ceiling_height, sector.floor_height));
  if (!kFloor && !up) target = std::max(target, std::min(sector.floor_height, sector.ceiling_height));
  const Fixed height = kFloor ? sector.floor_height : sector.ceiling_height;
  const int64_t next = int64_t{height} + (up ? speed : -int64_t{speed});
  if (up ? next >= target : next <= target) {
    place_plane<kFloor>(world, index, target, crush, true);
    return PlaneStep::kArrived;
  }
  const bool crushes_on = crush >= 0 && !hexen_crush && up == kFloor;
  return place_plane<kFloor>(world, index, static_cast<Fixed>(next), crush, !crushes_on)
             ? PlaneStep::kMoved
             : PlaneStep::kBlocked;
}

void tic_mover(World& world, SectorMover& mover) {
  switch (mover.kind) {
    case MoverKind::kDoor:
      return tic_door(world, mover);
    case MoverKind::kPlat:
      return tic_plat(world, mover);
    case MoverKind::kFloor:
    case MoverKind::kStair:
      return tic_floor(world, mover);
    case MoverKind::kCeiling:
      return tic_ceiling(world, mover);
    case MoverKind::kCrusher:
      return tic_crusher(world, mover);
    case MoverKind::kElevator:
      return tic_elevator(world, mover);
    case MoverKind::kPillar:
      return tic_pillar(world, mover);
    case MoverKind::kWaggle:
      return tic_waggle(world, mover);
  }
}

/// Forgets the movers that have arrived; keeps the order.
void compact(StableList<SectorMover>& movers) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < movers.size(); ++i) {
    if (movers[i].removed) continue;
    if (kept != i) movers[kept] = std::move(movers[i]);
    ++kept;
  }
  movers.resize_down(kept);
}

}  // namespace

// ---------------------------------------------------------------- the interface

std::optional<int32_t> execute_mover_special(World& world, const SpecialCall& call) {
  if (world.state().movers.plane_busy.size() != world.sectors().size()) start_movers(world);
  for (const auto family : {execute_door, execute_plat, execute_floor, execute_ceiling, execute_stairs,
                            execute_light, execute_scroller, execute_polyobject})
    if (const std::optional<int32_t> result = family(world, call)) return result;
  return std::nullopt;
}

std::size_t tic_movers(World& world, std::size_t count) {
  MoverState& movers = world.state().movers;
  tic_lights(world);
  count = std::min(count, movers.sectors.size());
  for (std::size_t i = 0; i < count; ++i)
    if (!movers.sectors[i].removed) tic_mover(world, movers.sectors[i]);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) kept += !movers.sectors[i].removed;
  if (kept != count) compact(movers.sectors);
  tic_polyobjects(world);
  tic_scrollers(world);
  tic_switches(world);
  return kept;
}

void tic_new_movers(World& world, std::size_t first, std::size_t first_scroller) {
  tic_scrollers(world, first_scroller);
  StableList<SectorMover>& sectors = world.state().movers.sectors;
  for (std::size_t i = first; i < sectors.size(); ++i)
    if (!sectors[i].removed) tic_mover(world, sectors[i]);
}

void start_movers(World& world) {
  MoverState& movers = world.state().movers;
  movers = MoverState{};
  movers.plane_busy.assign(world.sectors().size(), 0);
  movers.sectors.reserve(kSpareMovers);
  start_doors(world);
  start_lights(world);
  start_scrollers(world);
  start_polyobjects(world);
}

bool sector_is_moving(const World& world, uint32_t sector) {
  const MoverState& movers = world.state().movers;
  return sector < movers.plane_busy.size() && movers.plane_busy[sector] != 0;
}

// ---------------------------------------------------------------- what the families share

SectorMover& start_mover(World& world, const SectorMover& mover) {
  MoverState& movers = world.state().movers;
  movers.plane_busy[mover.sector] |= planes_of(mover);
  return movers.sectors.push_back(mover);
}

void stop_mover(World& world, SectorMover& mover) {
  if (mover.removed) return;
  mover.removed = true;
  world.state().movers.plane_busy[mover.sector] &= ~planes_of(mover);
}

SectorMover* find_mover(World& world, uint32_t sector, int32_t planes) {
  for (SectorMover& mover : world.state().movers.sectors)
    if (!mover.removed && mover.sector == sector && (planes_of(mover) & planes) != 0) return &mover;
  return nullptr;
}

PlaneStep step_floor(World& world, uint32_t sector, Fixed speed, Fixed target, bool up, int32_t crush,
                     bool hexen_crush) {
  return step_plane<true>(world, sector, speed, target, up, crush, hexen_crush);
}

PlaneStep step_ceiling(World& world, uint32_t sector, Fixed speed, Fixed target, bool up, int32_t crush,
                       bool hexen_crush) {
  return step_plane<false>(world, sector, speed, target, up, crush, hexen_crush);
}

Fixed texture_height(const World& world, const SpecialCall& call) {
  constexpr int kUnits = 64;
  if (world.index().warned_specials->first(call.number))
    spdlog::warn(
        "{}: special {} {} moves a plane by the height of a texture; here that is {} units, whatever the "
        "texture. Use the special that moves it by a value",
        world.level().name, call.number, wad::special_name(call.number), kUnits);
  return to_fixed(kUnits);
}

void clear_special(Sector& sector) {
  sector.special = 0;
  sector.damage_amount = sector.damage_interval = sector.damage_leak = 0;
}

void copy_special(Sector& to, const Sector& from) {
  to.special = from.special;
  to.damage_amount = from.damage_amount, to.damage_interval = from.damage_interval;
  to.damage_leak = from.damage_leak, to.damage_type = from.damage_type;
}

void set_change(const World& world, const SpecialCall& call, SectorMover& mover, int32_t change,
                bool of_ceiling) {
  if ((change & 3) == 0) return;
  std::optional<uint32_t> model;
  if ((change & 4) != 0) {
    model = of_ceiling ? neighbour_with_ceiling(world, mover.sector, mover.target)
                       : neighbour_with_floor(world, mover.sector, mover.target);
  } else {
    model = front_sector_of(world, call);
  }
  if (!model) return;
  const Sector& sector = world.sectors()[*model];
  mover.texture = of_ceiling ? sector.ceiling_texture : sector.floor_texture;
  if ((change & 3) == 1) mover.new_special = 0;
  if ((change & 3) == 3)
    mover.new_special = sector.special, mover.model_sector = static_cast<int32_t>(*model);
}

void finish_change(World& world, const SectorMover& mover, bool of_ceiling) {
  Sector& sector = world.state().sectors[mover.sector];
  if (!mover.texture.empty()) (of_ceiling ? sector.ceiling_texture : sector.floor_texture) = mover.texture;
  if (mover.new_special < 0) return;
  if (mover.model_sector >= 0) {
    copy_special(sector, world.sectors()[static_cast<std::size_t>(mover.model_sector)]);
  } else {
    clear_special(sector);
  }
}

void set_light_part_way(World& world, int32_t tag, Fixed fraction) {
  if (tag == 0) return;
  for_each_tagged_sector(world, tag, [&](uint32_t index) {
    const int32_t bright = max_light_around(world, index);
    const int32_t dark = min_light_around(world, index, world.sectors()[index].light);
    const int64_t part = std::clamp<Fixed>(fraction, 0, kFracUnit);
    world.state().sectors[index].light =
        static_cast<int32_t>((part * bright + (kFracUnit - part) * dark) / kFracUnit);
  });
}

}  // namespace comrad::doom
