// What moves several sectors or planes by one order: stairs, pillars, donuts.
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

// ---------------------------------------------------------------- stairs

constexpr int32_t kStairsSpecial1 = 26, kStairsSpecial2 = 27;  // sector types of a marked flight, in turn

struct StairsOrder {
  bool up = true;
  Fixed step = 0, speed = 0;
  int32_t delay_tics = 0;  // after each step of height
  int32_t reset_tics = 0;  // 0: they stay
  bool any_texture = false;
  bool marked = false;    // the next step is known by its sector type, not by the lines' front sides
  bool together = false;  // all steps arrive at the same time
  int32_t crush = -1;
};

void start_stair(World& world, uint32_t sector, Fixed height, const StairsOrder& order) {
  const Fixed floor = world.sectors()[sector].floor_height;
  SectorMover stair;
  stair.sector = sector;
  stair.kind = MoverKind::kStair;
  stair.phase = order.up ? MoverPhase::kUp : MoverPhase::kDown;
  stair.speed = order.speed;
  if (order.together && order.step != 0)
    stair.speed = static_cast<Fixed>(std::clamp<int64_t>(
        int64_t{order.speed} * std::abs(int64_t{height} - floor) / order.step, 0, units(16000)));
  stair.target = height;
  stair.base = floor;
  stair.left_tics = order.reset_tics;
  stair.stair_delay = static_cast<uint32_t>(order.delay_tics);
  if (order.delay_tics > 0 && order.speed > 0) stair.step_tics = std::max(1, order.step / order.speed);
  stair.step_left_tics = stair.step_tics;
  stair.crush = order.crush;
  start_mover(world, stair);
}

/// The step after `sector` by the lines that it is the front of; a step on its way is passed over.
std::optional<uint32_t> next_by_lines(const World& world, uint32_t sector, const std::string& texture,
                                      bool any_texture) {
  const Level& level = world.level();
  for (const uint32_t index : level.sector_linedefs[sector]) {
    const Linedef& line = level.linedefs[index];
    if (!line.back || level.sidedefs[line.front].sector_index != sector) continue;
    const uint32_t back = level.sidedefs[*line.back].sector_index;
    if (back == sector || (!any_texture && world.sectors()[back].floor_texture != texture)) continue;
    if (!is_busy(world, back, kFloorPlane)) return back;
  }
  return std::nullopt;
}

std::optional<uint32_t> next_by_mark(const World& world, uint32_t sector, uint32_t previous) {
  const int32_t mark = world.sectors()[sector].special & kTypeMask;
  const int32_t wanted = mark == kStairsSpecial1 ? kStairsSpecial2 : kStairsSpecial1;
  std::optional<uint32_t> next;
  for_each_neighbour(world, sector, [&](uint32_t other) {
    if (!next && other != previous && (world.sectors()[other].special & kTypeMask) == wanted) next = other;
  });
  return next;
}

int32_t build_stairs(World& world, const SpecialCall& call, int32_t tag, const StairsOrder& order) {
  const int64_t rise = order.up ? order.step : -int64_t{order.step};
  return for_each_target(world, call, tag, [&](uint32_t first) {
    if (is_busy(world, first, kFloorPlane)) return false;
    const std::string texture = world.sectors()[first].floor_texture;
    Fixed height = height_sum(world.sectors()[first].floor_height, rise);
    start_stair(world, first, height, order);
    uint32_t sector = first, previous = first;
    for (std::size_t steps = 0; steps < world.sectors().size(); ++steps) {
      const std::optional<uint32_t> next = order.marked
                                               ? next_by_mark(world, sector, previous)
                                               : next_by_lines(world, sector, texture, order.any_texture);
      if (!next) break;
      height = height_sum(height, rise);
      if (!is_busy(world, *next, kFloorPlane)) start_stair(world, *next, height, order);
      previous = sector, sector = *next;
    }
    return true;
  });
}

// ---------------------------------------------------------------- pillars

/// Both planes arrive at the same time: the one with the longer way at `speed`.
void share_speed(SectorMover& pillar, Fixed speed, int64_t floor_way, int64_t ceiling_way) {
  const int64_t longer = std::max<int64_t>({floor_way, ceiling_way, 1});
  pillar.speed = static_cast<Fixed>(int64_t{speed} * floor_way / longer);
  pillar.return_speed = static_cast<Fixed>(int64_t{speed} * ceiling_way / longer);
}

int32_t build_pillar(World& world, const SpecialCall& call, int32_t crush) {
  const auto& a = call.args;  // tag, speed, height above the floor (0: half way), ...
  return for_each_target(world, call, a[0], [&](uint32_t index) {
    const Sector& sector = world.sectors()[index];
    if (is_busy(world, index, kBothPlanes) || sector.floor_height == sector.ceiling_height) return false;
    SectorMover pillar;
    pillar.sector = index;
    pillar.kind = MoverKind::kPillar;
    pillar.phase = MoverPhase::kUp;
    const int64_t room = int64_t{sector.ceiling_height} - sector.floor_height;
    pillar.target =
        a[2] == 0 ? height_sum(sector.floor_height, room / 2) : height_sum(sector.floor_height, units(a[2]));
    pillar.high_2 = pillar.target;
    share_speed(pillar, speed_of(a[1]), std::abs(int64_t{pillar.target} - sector.floor_height),
                std::abs(int64_t{sector.ceiling_height} - pillar.target));
    pillar.crush = crush, pillar.hexen_crush = true;  // whatever its crush mode
    start_mover(world, pillar);
    return true;
  });
}

int32_t open_pillar(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // tag, speed, floor's way, ceiling's way (0: as the sectors around)
  return for_each_target(world, call, a[0], [&](uint32_t index) {
    const Sector& sector = world.sectors()[index];
    if (is_busy(world, index, kBothPlanes) || sector.floor_height != sector.ceiling_height) return false;
    SectorMover pillar;
    pillar.sector = index;
    pillar.kind = MoverKind::kPillar;
    pillar.phase = MoverPhase::kDown;
    pillar.target = a[2] == 0 ? lowest_floor_around(world, index)
                              : height_sum(sector.floor_height, -int64_t{units(a[2])});
    pillar.high_2 =
        a[3] == 0 ? highest_ceiling_around(world, index) : height_sum(sector.ceiling_height, units(a[3]));
    share_speed(pillar, speed_of(a[1]), std::abs(int64_t{sector.floor_height} - pillar.target),
                std::abs(int64_t{pillar.high_2} - sector.ceiling_height));
    start_mover(world, pillar);
    return true;
  });
}

// ---------------------------------------------------------------- donuts

/// A pillar sinks and the ring round it rises, both to the floor of what lies round the ring; the ring takes
/// that floor's texture.
int32_t make_donut(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // tag, speed of the pillar, speed of the ring
  return for_each_target(world, call, a[0], [&](uint32_t pillar) {
    if (is_busy(world, pillar, kFloorPlane)) return false;
    std::optional<uint32_t> ring, model;
    for_each_neighbour(world, pillar, [&](uint32_t other) {
      if (!ring) ring = other;
    });
    if (!ring || is_busy(world, *ring, kFloorPlane)) return false;
    for_each_neighbour(world, *ring, [&](uint32_t other) {
      if (!model && other != pillar) model = other;
    });
    if (!model) return false;
    const Sector& around = world.sectors()[*model];
    SectorMover rising;
    rising.sector = *ring;
    rising.phase = MoverPhase::kUp;
    rising.speed = speed_of(a[2]);
    rising.target = around.floor_height;
    rising.texture = around.floor_texture;
    rising.new_special = 0;
    start_mover(world, rising);
    SectorMover sinking;
    sinking.sector = pillar;
    sinking.phase = MoverPhase::kDown;
    sinking.speed = speed_of(a[1]);
    sinking.target = around.floor_height;
    start_mover(world, sinking);
    return true;
  });
}

}  // namespace

std::optional<int32_t> execute_stairs(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  StairsOrder order;
  order.speed = speed_of(a[1]), order.step = units(std::max(a[2], 0));
  switch (call.number) {
    case Special::kStairs_BuildDown:  // tag, speed, step, delay, reset
    case Special::kStairs_BuildUp:
      order.up = call.number == Special::kStairs_BuildUp, order.marked = true;
      order.delay_tics = wait_of(a[3]), order.reset_tics = wait_of(a[4]);
      return build_stairs(world, call, a[0], order);
    case Special::kStairs_BuildDownSync:  // tag, speed, step, reset
    case Special::kStairs_BuildUpSync:
      order.up = call.number == Special::kStairs_BuildUpSync, order.marked = order.together = true;
      order.reset_tics = wait_of(a[3]);
      return build_stairs(world, call, a[0], order);
    case Special::kGeneric_Stairs: {  // tag, speed, step, flags (1 up, 2 any texture), reset
      order.up = (a[3] & 1) != 0, order.any_texture = (a[3] & 2) != 0;
      order.reset_tics = wait_of(a[4]);
      const int32_t result = build_stairs(world, call, a[0], order);
      // The next time they go the other way.
      if (result != 0 && has_line(world, call) &&
          static_cast<std::size_t>(call.line) < world.state().lines.size())
        world.state().lines[static_cast<std::size_t>(call.line)].args[3] ^= 1;
      return result;
    }
    case Special::kStairs_BuildUpDoom:  // tag, speed, step, delay, reset
    case Special::kStairs_BuildDownDoom:
    case Special::kStairs_BuildUpDoomCrush:
      order.up = call.number != Special::kStairs_BuildDownDoom,
      order.crush = call.number == Special::kStairs_BuildUpDoomCrush ? 10 : -1;
      order.delay_tics = wait_of(a[3]), order.reset_tics = wait_of(a[4]);
      return build_stairs(world, call, a[0], order);
    case Special::kStairs_BuildUpDoomSync:  // tag, speed, step, reset
    case Special::kStairs_BuildDownDoomSync:
      order.up = call.number == Special::kStairs_BuildUpDoomSync, order.together = true;
      order.reset_tics = wait_of(a[3]);
      return build_stairs(world, call, a[0], order);
    case Special::kPillar_Build:  // tag, speed, height
      return build_pillar(world, call, -1);
    case Special::kPillar_BuildAndCrush:  // tag, speed, height, crush, crush mode
      return build_pillar(world, call, crush_of(a[3]));
    case Special::kPillar_Open:  // tag, speed, floor's way, ceiling's way
      return open_pillar(world, call);
    case Special::kFloor_Donut:  // tag, speed of the pillar, speed of the ring
      return make_donut(world, call);
    default:
      return std::nullopt;
  }
}

void tic_pillar(World& world, SectorMover& pillar) {
  const bool builds = pillar.phase == MoverPhase::kUp;
  const PlaneStep floor =
      step_floor(world, pillar.sector, pillar.speed, pillar.target, builds, pillar.crush, pillar.hexen_crush);
  const PlaneStep ceiling = step_ceiling(world, pillar.sector, pillar.return_speed, pillar.high_2, !builds,
                                         pillar.crush, pillar.hexen_crush);
  if (floor == PlaneStep::kArrived && ceiling == PlaneStep::kArrived) stop_mover(world, pillar);
}

}  // namespace comrad::doom
