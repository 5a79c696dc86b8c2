// Floors that go somewhere and stay; elevators, where the ceiling goes along; waggling planes.
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/movers.h"
#include "sim_workers/engine/specials/sector_bodies.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

struct FloorOrder {
  Fixed speed = 0;
  int32_t crush = -1;
  bool hexen_crush = false;
  int32_t change = 0;       // see set_change()
  bool change_now = false;  // at the start rather than at the end
};

/// Sends the floor to `target`; the direction counts where it lies the other way: then it jumps there.
bool start_floor(World& world, const SpecialCall& call, uint32_t index, Fixed target, bool up,
                 const FloorOrder& order) {
  SectorMover floor;
  floor.sector = index;
  floor.kind = MoverKind::kFloor;
  floor.phase = up ? MoverPhase::kUp : MoverPhase::kDown;
  floor.speed = order.speed;
  floor.target = target;
  floor.crush = order.crush;
  floor.hexen_crush = order.hexen_crush;
  set_change(world, call, floor, order.change, false);
  if (order.change_now) {
    finish_change(world, floor, false);
    floor.texture.clear(), floor.new_special = -1;
  }
  start_mover(world, floor);
  return true;
}

/// For each floor that rests, `find_target` (sector -> height) returns where to.
template <typename FindTarget>
int32_t order_floor(World& world, const SpecialCall& call, int32_t tag, bool up, const FloorOrder& order,
                    FindTarget find_target) {
  return for_each_target(world, call, tag, [&](uint32_t sector) {
    if (is_busy(world, sector, kFloorPlane)) return false;
    return start_floor(world, call, sector, find_target(sector), up, order);
  });
}

int32_t order_floor_to(World& world, const SpecialCall& call, Fixed height, const FloorOrder& order) {
  return for_each_target(world, call, call.args[0], [&](uint32_t sector) {
    if (is_busy(world, sector, kFloorPlane)) return false;
    return start_floor(world, call, sector, height, height > world.sectors()[sector].floor_height, order);
  });
}

/// The lowest ceiling around, its own included.
Fixed lowest_ceiling(const World& world, uint32_t sector) {
  return std::min(lowest_ceiling_around(world, sector), world.sectors()[sector].ceiling_height);
}

int32_t generic_floor(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // tag, speed, height, target, flags
  FloorOrder order;
  order.speed = speed_of(a[1]);
  order.change = a[4] & 7;
  const bool up = (a[4] & 8) != 0;
  order.crush = (a[4] & 16) != 0 ? kGenericCrush : -1;
  return order_floor(world, call, a[0], up, order, [&](uint32_t sector) -> Fixed {
    switch (a[3]) {
      case 1:
        return highest_floor_around(world, sector);
      case 2:
        return lowest_floor_around(world, sector);
      case 3:
        return up ? next_higher_floor(world, sector) : next_lower_floor(world, sector);
      case 4:
        return lowest_ceiling_around(world, sector);
      case 5:
        return world.sectors()[sector].ceiling_height;
      case 6:
        return height_sum(floor_of(world, sector), (up ? 1 : -1) * texture_height(world, call));
      default:
        return height_sum(floor_of(world, sector), (up ? 1 : -1) * int64_t{units(a[2])});
    }
  });
}

// ---------------------------------------------------------------- elevators

/// Floor and ceiling move together by the way of the floor.
bool start_elevator(World& world, uint32_t index, Fixed floor_target, Fixed speed) {
  if (is_busy(world, index, kBothPlanes)) return false;
  const Sector& sector = world.sectors()[index];
  SectorMover elevator;
  elevator.sector = index;
  elevator.kind = MoverKind::kElevator;
  elevator.phase = floor_target > sector.floor_height ? MoverPhase::kUp : MoverPhase::kDown;
  elevator.speed = speed;
  elevator.target = floor_target;
  elevator.high_2 = height_sum(sector.ceiling_height, int64_t{floor_target} - sector.floor_height);
  start_mover(world, elevator);
  return true;
}

template <typename FindTarget>
int32_t order_elevator(World& world, const SpecialCall& call, FindTarget find_target) {
  return for_each_target(world, call, call.args[0], [&](uint32_t sector) {
    return start_elevator(world, sector, find_target(sector), speed_of(call.args[1]));
  });
}

// ---------------------------------------------------------------- waggles

constexpr Fixed kWaggleSwing = to_fixed(8);  // of a waggle of full strength

int32_t order_waggle(World& world, const SpecialCall& call, int32_t planes) {
  const auto& a = call.args;  // tag, amplitude in 8ths, frequency, phase, seconds
  return for_each_target(world, call, a[0], [&](uint32_t index) {
    if (is_busy(world, index, planes)) return false;
    const int64_t amplitude = std::clamp(a[1], 0, 255);
    SectorMover waggle;
    waggle.sector = index;
    waggle.kind = MoverKind::kWaggle;
    waggle.type = planes;
    waggle.phase = MoverPhase::kUp;  // grows; then kWait, then kDown
    const Sector& sector = world.sectors()[index];
    waggle.base = planes == kFloorPlane ? sector.floor_height : sector.ceiling_height;
    waggle.phase_offset = static_cast<Fixed>((a[3] & 63) * kFracUnit);
    waggle.speed = static_cast<Fixed>(std::clamp(a[2], 0, 255)) << 10;
    waggle.high = static_cast<Fixed>(amplitude << 10);
    // It reaches its strength in 1 to 4 seconds, the stronger the later.
    waggle.growth = static_cast<Fixed>(waggle.high / (35 + (3 * 35) * amplitude / 255));
    waggle.left_tics = a[4] > 0 ? std::min(a[4], INT32_MAX / 35) * 35 : -1;
    start_mover(world, waggle);
    return true;
  });
}

}  // namespace

// ---------------------------------------------------------------- specials

std::optional<int32_t> execute_floor(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  const int32_t tag = a[0];
  FloorOrder order;
  order.speed = speed_of(a[1]);
  const auto by = [&](int64_t height) {
    return [&world, height](uint32_t sector) { return height_sum(floor_of(world, sector), height); };
  };
  const auto around = [&world](Fixed (*find)(const World&, uint32_t)) {
    return [&world, find](uint32_t sector) { return find(world, sector); };
  };
  switch (call.number) {
    case Special::kFloor_LowerByValue:  // tag, speed, height, change
      order.change = a[3];
      return order_floor(world, call, tag, false, order, by(-int64_t{units(a[2])}));
    case Special::kFloor_LowerToLowest:  // tag, speed, change
      order.change = a[2];
      return order_floor(world, call, tag, false, order, around(lowest_floor_around));
    case Special::kFloor_LowerToNearest:
      order.change = a[2];
      return order_floor(world, call, tag, false, order, around(next_lower_floor));
    case Special::kFloor_RaiseByValue:  // tag, speed, height, change
      order.change = a[3];
      return order_floor(world, call, tag, true, order, by(units(a[2])));
    case Special::kFloor_RaiseToHighest:  // tag, speed, change
      order.change = a[2];
      return order_floor(world, call, tag, true, order, around(highest_floor_around));
    case Special::kFloor_RaiseToNearest:
      order.change = a[2];
      return order_floor(world, call, tag, true, order, around(next_higher_floor));
    case Special::kFloor_RaiseAndCrush:      // tag, speed, crush, crush mode
    case Special::kFloor_RaiseAndCrushDoom:  // up to the lowest ceiling around
      order.crush = crush_of(a[2]), order.hexen_crush = is_hexen_crush(a[3]);
      return order_floor(world, call, tag, true, order, [&](uint32_t sector) {
        const Fixed ceiling = call.number == Special::kFloor_RaiseAndCrush
                                  ? world.sectors()[sector].ceiling_height
                                  : lowest_ceiling(world, sector);
        return height_sum(ceiling, -int64_t{kCrushGap});
      });
    case Special::kFloor_RaiseByValueTimes8:  // tag, speed, height, change
      order.change = a[3];
      return order_floor(world, call, tag, true, order, by(units(int64_t{a[2]} * 8)));
    case Special::kFloor_LowerByValueTimes8:
      order.change = a[3];
      return order_floor(world, call, tag, false, order, by(-int64_t{units(int64_t{a[2]} * 8)}));
    case Special::kFloor_MoveToValue:  // tag, speed, height, below zero, change
    case Special::kFloor_MoveToValueTimes8: {
      order.change = a[4];
      const int64_t height =
          int64_t{a[2]} * (call.number == Special::kFloor_MoveToValueTimes8 ? 8 : 1) * (a[3] != 0 ? -1 : 1);
      return order_floor_to(world, call, units(height), order);
    }
    case Special::kFloor_CrushStop:  // tag
    case Special::kFloor_Stop: {
      bool any = false;
      for (SectorMover& mover : world.state().movers.sectors) {
        if (mover.removed || (mover.kind != MoverKind::kFloor && mover.kind != MoverKind::kStair)) continue;
        if (world.sectors()[mover.sector].tag != tag ||
            (call.number == Special::kFloor_CrushStop && mover.crush < 0))
          continue;
        stop_mover(world, mover);
        any = true;
      }
      return any ? 1 : 0;
    }
    case Special::kFloor_LowerInstant:    // tag, -, height in 8 units, change
    case Special::kFloor_RaiseInstant: {  // tag, -, height in 8 units, change
      const Fixed height = units(int64_t{a[2]} * 8);
      order.speed = std::max(height, 0), order.change = a[3];
      return order_floor(
          world, call, tag, call.number == Special::kFloor_RaiseInstant, order,
          by(call.number == Special::kFloor_RaiseInstant ? int64_t{height} : -int64_t{height}));
    }
    case Special::kCeiling_Waggle:
      return order_waggle(world, call, kCeilingPlane);
    case Special::kFloor_Waggle:
      return order_waggle(world, call, kFloorPlane);
    case Special::kFloorAndCeiling_LowerByValue:  // tag, speed, height
      return order_elevator(world, call, by(-int64_t{units(a[2])}));
    case Special::kFloorAndCeiling_RaiseByValue:
      return order_elevator(world, call, by(units(a[2])));
    case Special::kGeneric_Floor:
      return generic_floor(world, call);
    case Special::kFloor_TransferTrigger:  // tag
    case Special::kFloor_TransferNumeric: {
      return for_each_target(world, call, tag, [&](uint32_t sector) {
        const std::optional<uint32_t> model =
            call.number == Special::kFloor_TransferTrigger
                ? front_sector_of(world, call)
                : neighbour_with_floor(world, sector, floor_of(world, sector));
        if (!model) return false;
        Sector& changed = world.state().sectors[sector];
        changed.floor_texture = world.sectors()[*model].floor_texture;
        copy_special(changed, world.sectors()[*model]);
        return true;
      });
    }
    case Special::kFloor_RaiseToLowestCeiling:  // tag, speed, change
      order.change = a[2];
      return order_floor(world, call, tag, true, order,
                         [&](uint32_t sector) { return lowest_ceiling(world, sector); });
    case Special::kFloor_RaiseByValueTxTy:  // tag, speed, height
      order.change = 3, order.change_now = true;
      return order_floor(world, call, tag, true, order, by(units(a[2])));
    case Special::kFloor_RaiseByTexture:  // tag, speed, change
      order.change = a[2];
      return order_floor(world, call, tag, true, order, by(texture_height(world, call)));
    case Special::kFloor_LowerByTexture:
      order.change = a[2];
      return order_floor(world, call, tag, false, order, by(-int64_t{texture_height(world, call)}));
    case Special::kFloor_LowerToLowestTxTy:  // tag, speed
      order.change = 7;
      return order_floor(world, call, tag, false, order, around(lowest_floor_around));
    case Special::kFloor_LowerToHighest:      // tag, speed, adjust, always adjust
    case Special::kFloor_LowerToHighestEE: {  // tag, speed, change
      if (call.number == Special::kFloor_LowerToHighestEE) order.change = a[2];
      return order_floor(world, call, tag, false, order, [&](uint32_t sector) {
        const Fixed height = highest_floor_around(world, sector);
        if (call.number == Special::kFloor_LowerToHighestEE ||
            (a[3] != 1 && height == floor_of(world, sector)))
          return height;
        return height_sum(height, units(int64_t{a[2]} - 128));
      });
    }
    case Special::kElevator_RaiseToNearest:  // tag, speed
      return order_elevator(world, call, around(next_higher_floor));
    case Special::kElevator_LowerToNearest:
      return order_elevator(world, call, around(next_lower_floor));
    case Special::kElevator_MoveToFloor: {  // to the floor in front of the calling line
      const std::optional<uint32_t> front = front_sector_of(world, call);
      if (!front) return 0;
      return order_elevator(world, call, [&](uint32_t) { return floor_of(world, *front); });
    }
    case Special::kFloor_RaiseToLowest:  // tag, speed, change, crush
      order.change = a[2], order.crush = crush_of(a[3]);
      return order_floor(world, call, tag, true, order, around(lowest_floor_around));
    case Special::kFloor_LowerToLowestCeiling:  // tag, speed, change
      order.change = a[2];
      return order_floor(world, call, tag, false, order, around(lowest_ceiling_around));
    case Special::kFloor_RaiseToCeiling:  // tag, speed, change, crush, gap
      order.change = a[2], order.crush = crush_of(a[3]);
      return order_floor(world, call, tag, true, order, [&](uint32_t sector) {
        return height_sum(world.sectors()[sector].ceiling_height, -int64_t{units(a[4])});
      });
    case Special::kFloor_ToCeilingInstant:  // tag, change, crush, gap
      order.speed = units(16000), order.change = a[1], order.crush = crush_of(a[2]);
      return order_floor(world, call, tag, true, order, [&](uint32_t sector) {
        return height_sum(world.sectors()[sector].ceiling_height, -int64_t{units(a[3])});
      });
    default:
      return std::nullopt;
  }
}

// ---------------------------------------------------------------- each tic

void tic_floor(World& world, SectorMover& floor) {
  // Stairs that come back after a while.
  if (floor.kind == MoverKind::kStair) {
    if (floor.left_tics > 0 && --floor.left_tics == 0) {
      std::swap(floor.target, floor.base);
      floor.phase =
          floor.target > world.sectors()[floor.sector].floor_height ? MoverPhase::kUp : MoverPhase::kDown;
      floor.wait_tics = 0;  // has come back: ends when it arrives
      floor.step_tics = 0;
    }
    if (floor.pause_tics > 0) {
      --floor.pause_tics;
      return;
    }
    if (floor.step_tics > 0 && --floor.step_left_tics == 0) {
      floor.pause_tics = static_cast<int32_t>(floor.stair_delay);
      floor.step_left_tics = floor.step_tics;
    }
    if (floor.phase == MoverPhase::kWait) return;
  }
  const bool up = floor.phase == MoverPhase::kUp;
  if (step_floor(world, floor.sector, floor.speed, floor.target, up, floor.crush, floor.hexen_crush) !=
      PlaneStep::kArrived)
    return;
  if (floor.kind == MoverKind::kStair && floor.left_tics > 0) {
    floor.phase = MoverPhase::kWait;
    return;
  }
  finish_change(world, floor, false);
  stop_mover(world, floor);
}

void tic_elevator(World& world, SectorMover& elevator) {
  const bool up = elevator.phase == MoverPhase::kUp;
  // The plane ahead goes first, so that the sector is never thinner than it was.
  PlaneStep step;
  if (up) {
    step = step_ceiling(world, elevator.sector, elevator.speed, elevator.high_2, true);
    if (step != PlaneStep::kBlocked)
      step = step_floor(world, elevator.sector, elevator.speed, elevator.target, true);
  } else {
    step = step_floor(world, elevator.sector, elevator.speed, elevator.target, false);
    if (step != PlaneStep::kBlocked)
      step = step_ceiling(world, elevator.sector, elevator.speed, elevator.high_2, false);
  }
  if (step == PlaneStep::kArrived) stop_mover(world, elevator);
}

void tic_waggle(World& world, SectorMover& waggle) {
  const bool of_floor = waggle.type == kFloorPlane;
  const Sector& sector = world.sectors()[waggle.sector];
  const auto place = [&](Fixed height) {  // in a shut sector past the other plane, as in ViZDoom
    if (of_floor) {
      const Fixed old = sector.floor_height;
      world.state().sectors[waggle.sector].floor_height = height;
      settle_bodies(world, waggle.sector, height > old ? PlaneChange::kFloorUp : PlaneChange::kFloorDown,
                    std::abs(height - old), 1);
    } else {
      const Fixed old = sector.ceiling_height;
      world.state().sectors[waggle.sector].ceiling_height = height;
      settle_bodies(world, waggle.sector, height > old ? PlaneChange::kCeilingUp : PlaneChange::kCeilingDown,
                    std::abs(height - old), 1);
    }
  };
  switch (waggle.phase) {
    case MoverPhase::kUp:
      waggle.amplitude += waggle.growth;
      if (waggle.amplitude >= waggle.high) waggle.amplitude = waggle.high, waggle.phase = MoverPhase::kWait;
      break;
    case MoverPhase::kDown:
      waggle.amplitude -= waggle.growth;
      if (waggle.amplitude <= 0 || waggle.growth <= 0) {
        place(waggle.base);
        return stop_mover(world, waggle);
      }
      break;
    default:
      if (waggle.left_tics > 0 && --waggle.left_tics == 0) waggle.phase = MoverPhase::kDown;
      break;
  }
  waggle.phase_offset =
      static_cast<Fixed>((int64_t{waggle.phase_offset} + waggle.speed) & (64 * kFracUnit - 1));
  const Fixed sine = fine_sine(static_cast<Angle>(waggle.phase_offset) << 10);  // 64 units are a turn
  place(height_sum(waggle.base, fixed_mul(fixed_mul(sine, kWaggleSwing), waggle.amplitude)));
}

}  // namespace comrad::doom
