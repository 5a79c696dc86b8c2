// Ceilings that go somewhere and stay, and crushers, which go down and up for ever.
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/movers.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

constexpr Fixed kGrindSpeed = kFracUnit / 8;

struct CeilingOrder {
  Fixed speed = 0;
  int32_t crush = -1;
  bool hexen_crush = false;
  int32_t change = 0;
};

bool start_ceiling(World& world, const SpecialCall& call, uint32_t index, Fixed target, bool up,
                   const CeilingOrder& order) {
  if (is_busy(world, index, kCeilingPlane)) return false;
  SectorMover ceiling;
  ceiling.sector = index;
  ceiling.kind = MoverKind::kCeiling;
  ceiling.tag = call.args[0];
  ceiling.phase = up ? MoverPhase::kUp : MoverPhase::kDown;
  ceiling.speed = order.speed;
  ceiling.target = target;
  ceiling.crush = order.crush;
  ceiling.hexen_crush = order.hexen_crush;
  set_change(world, call, ceiling, order.change, true);
  start_mover(world, ceiling);
  return true;
}

template <typename FindTarget>
int32_t order_ceiling(World& world, const SpecialCall& call, bool up, const CeilingOrder& order,
                      FindTarget find_target) {
  return for_each_target(world, call, call.args[0], [&](uint32_t sector) {
    return start_ceiling(world, call, sector, find_target(sector), up, order);
  });
}

int32_t order_ceiling_to(World& world, const SpecialCall& call, Fixed height, const CeilingOrder& order) {
  return for_each_target(world, call, call.args[0], [&](uint32_t sector) {
    return start_ceiling(world, call, sector, height, height > ceiling_of(world, sector), order);
  });
}

int32_t generic_ceiling(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // tag, speed, height, target, flags
  CeilingOrder order;
  order.speed = speed_of(a[1]);
  order.change = a[4] & 7;
  const bool up = (a[4] & 8) != 0;
  order.crush = (a[4] & 16) != 0 ? kGenericCrush : -1;
  return order_ceiling(world, call, up, order, [&](uint32_t sector) -> Fixed {
    switch (a[3]) {
      case 1:
        return highest_ceiling_around(world, sector);
      case 2:
        return lowest_ceiling_around(world, sector);
      case 3:
        return up ? next_higher_ceiling(world, sector) : next_lower_ceiling(world, sector);
      case 4:
        return highest_floor_around(world, sector);
      case 5:
        return floor_of(world, sector);
      case 6:
        return height_sum(ceiling_of(world, sector), (up ? 1 : -1) * texture_height(world, call));
      default:
        return height_sum(ceiling_of(world, sector), (up ? 1 : -1) * int64_t{units(a[2])});
    }
  });
}

// ---------------------------------------------------------------- crushers

enum CrusherType : int32_t { kCrushForEver, kCrushOnce };

struct CrusherOrder {
  CrusherType type = kCrushForEver;
  Fixed speed = 0, return_speed = 0;
  int32_t crush = -1;
  bool hexen_crush = false;
  Fixed gap = 0;  // it stops that high above its floor
};

bool start_one_crusher(World& world, uint32_t index, int32_t tag, const CrusherOrder& order) {
  if (is_busy(world, index, kCeilingPlane)) return false;
  SectorMover crusher;
  crusher.sector = index;
  crusher.kind = MoverKind::kCrusher;
  crusher.type = order.type;
  crusher.tag = tag;
  crusher.phase = MoverPhase::kDown;
  crusher.speed = order.speed;
  crusher.return_speed = order.return_speed;
  crusher.crush = order.crush;
  crusher.hexen_crush = order.hexen_crush;
  crusher.high = ceiling_of(world, index);
  crusher.low = height_sum(floor_of(world, index), order.gap);
  crusher.amplitude = order.speed;  // the present speed: slows on a body
  start_mover(world, crusher);
  return true;
}

int32_t order_crusher(World& world, const SpecialCall& call, const CrusherOrder& order) {
  int32_t result = 0;
  // Those that Ceiling_CrushStop holds continue.
  for (SectorMover& mover : world.state().movers.sectors) {
    if (mover.removed || mover.kind != MoverKind::kCrusher || mover.phase != MoverPhase::kInStasis) continue;
    if (mover.tag != call.args[0]) continue;
    mover.phase = static_cast<MoverPhase>(mover.low_2);
    result = 1;
  }
  return for_each_target(
             world, call, call.args[0],
             [&](uint32_t index) { return start_one_crusher(world, index, call.args[0], order); }) |
         result;
}

int32_t hold_crushers(World& world, int32_t tag) {
  bool any = false;
  for (SectorMover& mover : world.state().movers.sectors) {
    if (mover.removed || mover.tag != tag || mover.kind != MoverKind::kCrusher ||
        mover.phase == MoverPhase::kInStasis)
      continue;
    mover.low_2 = static_cast<int32_t>(mover.phase);
    mover.phase = MoverPhase::kInStasis;
    any = true;
  }
  return any ? 1 : 0;
}

int32_t stop_ceilings(World& world, int32_t tag) {
  bool any = false;
  for (SectorMover& mover : world.state().movers.sectors) {
    if (mover.removed || planes_of(mover) != kCeilingPlane || world.sectors()[mover.sector].tag != tag)
      continue;
    stop_mover(world, mover);
    any = true;
  }
  return any ? 1 : 0;
}

}  // namespace

std::optional<int32_t> execute_ceiling(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  CeilingOrder order;
  order.speed = speed_of(a[1]);
  CrusherOrder crusher;
  crusher.speed = speed_of(a[1]);
  crusher.return_speed = crusher.speed / 2;
  const auto by = [&](int64_t height) {
    return [&world, height](uint32_t sector) { return height_sum(ceiling_of(world, sector), height); };
  };
  const auto around = [&world](Fixed (*find)(const World&, uint32_t)) {
    return [&world, find](uint32_t sector) { return find(world, sector); };
  };
  switch (call.number) {
    case Special::kCeiling_LowerByValue:  // tag, speed, height, change
      order.change = a[3];
      return order_ceiling(world, call, false, order, by(-int64_t{units(a[2])}));
    case Special::kCeiling_RaiseByValue:  // tag, speed, height, change
      order.change = a[3];
      return order_ceiling(world, call, true, order, by(units(a[2])));
    case Special::kCeiling_CrushAndRaise:  // tag, speed, crush, crush mode
      crusher.crush = crush_of(a[2]), crusher.hexen_crush = is_hexen_crush(a[3]);
      return order_crusher(world, call, crusher);
    case Special::kCeiling_LowerAndCrush:  // tag, speed, crush, crush mode
      order.crush = crush_of(a[2]), order.hexen_crush = is_hexen_crush(a[3]);
      return order_ceiling(world, call, false, order,
                           [&](uint32_t sector) { return height_sum(floor_of(world, sector), kCrushGap); });
    case Special::kCeiling_CrushStop:  // tag, 3 for good
      return a[1] == 3 ? stop_ceilings(world, a[0]) : hold_crushers(world, a[0]);
    case Special::kCeiling_Stop:
      return stop_ceilings(world, a[0]);
    case Special::kCeiling_CrushRaiseAndStay:  // tag, speed, crush, crush mode
      crusher.type = kCrushOnce;
      crusher.crush = crush_of(a[2]), crusher.hexen_crush = is_hexen_crush(a[3]);
      return order_crusher(world, call, crusher);
    case Special::kCeiling_MoveToValue:  // tag, speed, height, below zero, change
    case Special::kCeiling_MoveToValueTimes8: {
      order.change = a[4];
      const int64_t height =
          int64_t{a[2]} * (call.number == Special::kCeiling_MoveToValueTimes8 ? 8 : 1) * (a[3] != 0 ? -1 : 1);
      return order_ceiling_to(world, call, units(height), order);
    }
    case Special::kCeiling_LowerAndCrushDist:
      // tag, speed, crush, distance, crush mode; the engine that ours follows ignores the distance
      order.crush = crush_of(a[2]), order.hexen_crush = is_hexen_crush(a[4]);
      return order_ceiling(world, call, false, order,
                           [&](uint32_t sector) { return floor_of(world, sector); });
    case Special::kCeiling_CrushAndRaiseSilentDist:  // tag, distance, speed, crush, crush mode
    case Special::kCeiling_CrushAndRaiseDist:
      crusher.gap = units(a[1]);
      crusher.speed = crusher.return_speed = speed_of(a[2]);
      crusher.crush = crush_of(a[3]), crusher.hexen_crush = is_hexen_crush(a[4]);
      return order_crusher(world, call, crusher);
    case Special::kGeneric_Crusher2:
    case Special::kGeneric_Crusher:  // tag, speed down, speed up, silent, crush
      crusher.return_speed = speed_of(a[2]);
      crusher.crush = crush_of(a[4]);
      crusher.hexen_crush = call.number == Special::kGeneric_Crusher2;
      return order_crusher(world, call, crusher);
    case Special::kCeiling_LowerToHighestFloor:  // tag, speed, change, -, gap
      order.change = a[2];
      return order_ceiling(world, call, false, order, [&](uint32_t sector) {
        return height_sum(highest_floor_around(world, sector), units(a[4]));
      });
    case Special::kCeiling_LowerInstant:    // tag, -, height in 8 units, change
    case Special::kCeiling_RaiseInstant: {  // tag, -, height in 8 units, change
      const Fixed height = units(int64_t{a[2]} * 8);
      order.speed = std::max(height, 0), order.change = a[3];
      return order_ceiling(
          world, call, call.number == Special::kCeiling_RaiseInstant, order,
          by(call.number == Special::kCeiling_RaiseInstant ? int64_t{height} : -int64_t{height}));
    }
    case Special::kCeiling_CrushRaiseAndStayA:  // tag, speed down, speed up, crush, crush mode
    case Special::kCeiling_CrushRaiseAndStaySilA:
      crusher.type = kCrushOnce;
      [[fallthrough]];
    case Special::kCeiling_CrushAndRaiseA:
    case Special::kCeiling_CrushAndRaiseSilentA:
      crusher.return_speed = speed_of(a[2]);
      crusher.crush = crush_of(a[3]), crusher.hexen_crush = is_hexen_crush(a[4]);
      return order_crusher(world, call, crusher);
    case Special::kCeiling_RaiseByValueTimes8:  // tag, speed, height, change
      order.change = a[3];
      return order_ceiling(world, call, true, order, by(units(int64_t{a[2]} * 8)));
    case Special::kCeiling_LowerByValueTimes8:  // tag, speed, height, change
      order.change = a[3];
      return order_ceiling(world, call, false, order, by(-int64_t{units(int64_t{a[2]} * 8)}));
    case Special::kGeneric_Ceiling:
      return generic_ceiling(world, call);
    case Special::kFloorAndCeiling_LowerRaise: {  // tag, floor speed, ceiling speed
      SpecialCall floor = call;
      floor.number = Special::kFloor_LowerToLowest, floor.args = {a[0], a[1], 0, 0, 0};
      order.speed = speed_of(a[2]);
      const int32_t ceiling_result = order_ceiling(world, call, true, order, around(highest_ceiling_around));
      return execute_floor(world, floor).value_or(0) | ceiling_result;
    }
    case Special::kCeiling_RaiseToNearest:  // tag, speed, change
      order.change = a[2];
      return order_ceiling(world, call, true, order, around(next_higher_ceiling));
    case Special::kCeiling_LowerToLowest:  // tag, speed, change
      order.change = a[2];
      return order_ceiling(world, call, false, order, around(lowest_ceiling_around));
    case Special::kCeiling_LowerToFloor:  // tag, speed, change, -, gap
      order.change = a[2];
      return order_ceiling(world, call, false, order,
                           [&](uint32_t sector) { return height_sum(floor_of(world, sector), units(a[4])); });
    case Special::kCeiling_RaiseToHighest:  // tag, speed, change
      order.change = a[2];
      return order_ceiling(world, call, true, order, around(highest_ceiling_around));
    case Special::kCeiling_ToHighestInstant:  // tag, change, crush
      order.speed = units(16000), order.change = a[1], order.crush = crush_of(a[2]);
      return order_ceiling(world, call, true, order, around(highest_ceiling_around));
    case Special::kCeiling_LowerToNearest:  // tag, speed, change, crush
      order.change = a[2], order.crush = crush_of(a[3]);
      return order_ceiling(world, call, false, order, around(next_lower_ceiling));
    case Special::kCeiling_RaiseToLowest:  // tag, speed, change
      order.change = a[2];
      return order_ceiling(world, call, true, order, around(lowest_ceiling_around));
    case Special::kCeiling_RaiseToHighestFloor:  // tag, speed, change
      order.change = a[2];
      return order_ceiling(world, call, true, order, around(highest_floor_around));
    case Special::kCeiling_ToFloorInstant:  // tag, change, crush, gap
      order.speed = units(16000), order.change = a[1], order.crush = crush_of(a[2]);
      return order_ceiling(world, call, false, order,
                           [&](uint32_t sector) { return height_sum(floor_of(world, sector), units(a[3])); });
    case Special::kCeiling_RaiseByTexture:  // tag, speed, change
      order.change = a[2];
      return order_ceiling(world, call, true, order, by(texture_height(world, call)));
    case Special::kCeiling_LowerByTexture:  // tag, speed, change, crush
      order.change = a[2], order.crush = crush_of(a[3]);
      return order_ceiling(world, call, false, order, by(-int64_t{texture_height(world, call)}));
    default:
      return std::nullopt;
  }
}

void tic_ceiling(World& world, SectorMover& ceiling) {
  const bool up = ceiling.phase == MoverPhase::kUp;
  const PlaneStep step = step_ceiling(world, ceiling.sector, ceiling.speed, ceiling.target, up, ceiling.crush,
                                      ceiling.hexen_crush);
  // The slow kind grinds, see tic_crusher().
  if (step == PlaneStep::kBlocked && ceiling.crush >= 0 && ceiling.speed == kFracUnit)
    ceiling.speed = kGrindSpeed;
  if (step != PlaneStep::kArrived) return;
  finish_change(world, ceiling, true);
  stop_mover(world, ceiling);
}

void tic_crusher(World& world, SectorMover& crusher) {
  switch (crusher.phase) {
    case MoverPhase::kDown:
      switch (step_ceiling(world, crusher.sector, crusher.amplitude, crusher.low, false, crusher.crush,
                           crusher.hexen_crush)) {
        case PlaneStep::kArrived:
          crusher.phase = MoverPhase::kUp;
          break;
        case PlaneStep::kBlocked:
          // The slow kind grinds: an eighth of its speed while a body is in the way.
          if (crusher.speed == kFracUnit && crusher.return_speed == kFracUnit)
            crusher.amplitude = kGrindSpeed;
          break;
        case PlaneStep::kMoved:
          break;
      }
      return;
    case MoverPhase::kUp:
      if (step_ceiling(world, crusher.sector, crusher.return_speed, crusher.high, true) !=
          PlaneStep::kArrived)
        return;
      if (crusher.type == kCrushOnce) return stop_mover(world, crusher);
      crusher.phase = MoverPhase::kDown;
      crusher.amplitude = crusher.speed;
      return;
    default:
      return;
  }
}

}  // namespace comrad::doom
