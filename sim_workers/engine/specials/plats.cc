// Lifts: floors that go down or up, wait, and come back.
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

enum PlatType : int32_t {
  kPerpetualRaise,
  kDownWaitUpStay,
  kDownByValue,
  kUpWaitDownStay,
  kUpNearestWaitDownStay,
  kUpByValue,
  kUpByValueStay,
  kRaiseAndStay,
  kRaiseAndStayLockout,
  kToggle,
  kDownToNearestFloor,
  kDownToLowestCeiling,
};

constexpr int32_t kPlatLip = 8;
constexpr int32_t kToggleCrush = 10;

struct PlatOrder {
  PlatType type = kDownWaitUpStay;
  Fixed speed = 0;
  int32_t wait_tics = 0;
  Fixed height = 0;    // of the kinds that move by a value
  Fixed lip = 0;       // above the lowest floor
  int32_t change = 0;  // 1: the texture of the calling line's front and no special; 2: the texture
};

/// Lifts of this tag that Plat_Stop holds continue.
void release_held(World& world, int32_t tag) {
  for (SectorMover& mover : world.state().movers.sectors) {
    if (mover.removed || mover.kind != MoverKind::kPlat || mover.phase != MoverPhase::kInStasis) continue;
    if (mover.tag != tag) continue;
    mover.phase = static_cast<MoverPhase>(mover.low_2);
  }
}

bool start_plat(World& world, const SpecialCall& call, uint32_t index, int32_t tag, const PlatOrder& order) {
  if (is_busy(world, index, kFloorPlane)) return false;
  const Fixed floor = world.sectors()[index].floor_height;
  SectorMover plat;
  plat.sector = index;
  plat.kind = MoverKind::kPlat;
  plat.type = order.type;
  plat.tag = tag;
  plat.speed = order.speed;
  plat.wait_tics = order.wait_tics;
  plat.low = plat.high = floor;
  if (order.change != 0) {
    if (const std::optional<uint32_t> model = front_sector_of(world, call)) {
      Sector& sector = world.state().sectors[index];
      sector.floor_texture = world.sectors()[*model].floor_texture;
      if (order.change == 1) clear_special(sector);
    }
  }
  const auto lowest = [&] {
    return std::min(floor, height_sum(lowest_floor_around(world, index), order.lip));
  };
  switch (order.type) {
    case kRaiseAndStay:
    case kRaiseAndStayLockout:
      plat.high = next_higher_floor(world, index);
      plat.phase = MoverPhase::kUp;
      break;
    case kUpByValue:
    case kUpByValueStay:
      plat.high = height_sum(floor, order.height);
      plat.phase = MoverPhase::kUp;
      break;
    case kDownByValue:
      plat.low = height_sum(floor, -int64_t{order.height});
      plat.phase = MoverPhase::kDown;
      break;
    case kDownWaitUpStay:
      plat.low = lowest();
      plat.phase = MoverPhase::kDown;
      break;
    case kUpNearestWaitDownStay:
      plat.high = next_higher_floor(world, index);
      plat.phase = MoverPhase::kUp;
      break;
    case kUpWaitDownStay:
      plat.high = std::max(floor, highest_floor_around(world, index));
      plat.phase = MoverPhase::kUp;
      break;
    case kPerpetualRaise:
      plat.low = lowest();
      plat.high = std::max(floor, highest_floor_around(world, index));
      plat.phase = (world.random_byte() & 1) != 0 ? MoverPhase::kDown : MoverPhase::kUp;
      break;
    case kToggle:
      plat.crush = kToggleCrush;
      plat.low = world.sectors()[index].ceiling_height;
      plat.phase = MoverPhase::kDown;
      break;
    case kDownToNearestFloor:
      plat.low = std::min(floor, height_sum(next_lower_floor(world, index), order.lip));
      plat.phase = MoverPhase::kDown;
      break;
    case kDownToLowestCeiling:
      plat.low = std::min(floor, lowest_ceiling_around(world, index));
      plat.phase = MoverPhase::kDown;
      break;
  }
  start_mover(world, plat);
  return true;
}

int32_t order_plat(World& world, const SpecialCall& call, int32_t tag, const PlatOrder& order) {
  int32_t result = 0;
  if (order.type == kPerpetualRaise || order.type == kToggle) {
    release_held(world, tag);
    if (order.type == kToggle) result = 1;
  }
  return for_each_target(world, call, tag,
                         [&](uint32_t sector) { return start_plat(world, call, sector, tag, order); }) |
         result;
}

int32_t hold_plats(World& world, int32_t tag) {
  for (SectorMover& mover : world.state().movers.sectors) {
    if (mover.removed || mover.kind != MoverKind::kPlat || mover.phase == MoverPhase::kInStasis ||
        mover.tag != tag)
      continue;
    mover.low_2 = static_cast<int32_t>(mover.phase);  // to continue with
    mover.phase = MoverPhase::kInStasis;
  }
  return 1;
}

void wait(SectorMover& plat) {
  plat.phase = MoverPhase::kWait;
  plat.left_tics = plat.wait_tics;
}

void hold_toggle(SectorMover& plat, MoverPhase next) {
  plat.low_2 = static_cast<int32_t>(next);
  plat.phase = MoverPhase::kInStasis;
}

void arrive_up(World& world, SectorMover& plat) {
  switch (plat.type) {
    case kToggle:
      return hold_toggle(plat, MoverPhase::kDown);
    case kDownWaitUpStay:
    case kDownByValue:
    case kDownToNearestFloor:
    case kDownToLowestCeiling:
    case kRaiseAndStay:
    case kUpByValueStay:
      return stop_mover(world, plat);
    case kRaiseAndStayLockout:
      wait(plat);  // its sector stays busy for ever
      plat.left_tics = 0;
      return;
    default:
      return wait(plat);
  }
}

void arrive_down(World& world, SectorMover& plat) {
  switch (plat.type) {
    case kToggle:
      return hold_toggle(plat, MoverPhase::kUp);
    case kUpByValue:
    case kUpWaitDownStay:
    case kUpNearestWaitDownStay:
    case kUpByValueStay:
    case kRaiseAndStay:
      return stop_mover(world, plat);
    default:
      return wait(plat);
  }
}

}  // namespace

std::optional<int32_t> execute_plat(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  PlatOrder order;
  order.speed = speed_of(a[1]);
  order.wait_tics = wait_of(a[2]);
  switch (call.number) {
    case Special::kPlat_PerpetualRaise:  // tag, speed, wait
      order.type = kPerpetualRaise, order.lip = units(kPlatLip);
      break;
    case Special::kPlat_Stop:  // tag
      return hold_plats(world, a[0]);
    case Special::kPlat_DownWaitUpStay:  // tag, speed, wait
      order.type = kDownWaitUpStay, order.lip = units(kPlatLip);
      break;
    case Special::kPlat_DownByValue:  // tag, speed, wait, height in 8 units
      order.type = kDownByValue, order.height = units(int64_t{a[3]} * 8);
      break;
    case Special::kPlat_UpWaitDownStay:
      order.type = kUpWaitDownStay;
      break;
    case Special::kPlat_UpByValue:  // tag, speed, wait, height in 8 units
      order.type = kUpByValue, order.height = units(int64_t{a[3]} * 8);
      break;
    case Special::kPlat_UpNearestWaitDownStay:
      order.type = kUpNearestWaitDownStay;
      break;
    case Special::kGeneric_Lift: {  // tag, speed, wait in octics, kind, height in 8 units
      constexpr PlatType kKinds[] = {kUpByValue, kDownWaitUpStay, kDownToNearestFloor, kDownToLowestCeiling,
                                     kPerpetualRaise};
      if (a[3] < 0 || a[3] > 4) return 0;
      order.type = kKinds[a[3]];
      order.wait_tics = octics(a[2]), order.height = units(int64_t{a[4]} * 8);
      break;
    }
    case Special::kPlat_DownWaitUpStayLip:  // tag, speed, wait, lip
      order.type = kDownWaitUpStay, order.lip = units(a[3]);
      break;
    case Special::kPlat_PerpetualRaiseLip:  // tag, speed, wait, lip
      order.type = kPerpetualRaise, order.lip = units(a[3]);
      break;
    case Special::kPlat_RaiseAndStayTx0:  // tag, speed, lockout
      order.type = a[2] == 1 ? kRaiseAndStayLockout : kRaiseAndStay;
      order.wait_tics = 0, order.change = 1;
      break;
    case Special::kPlat_UpByValueStayTx:  // tag, speed, height in 8 units
      order.type = kUpByValueStay, order.height = units(int64_t{a[2]} * 8);
      order.wait_tics = 0, order.change = 2;
      break;
    case Special::kPlat_ToggleCeiling:  // tag
      order.type = kToggle, order.speed = 0, order.wait_tics = 0;
      break;
    default:
      return std::nullopt;
  }
  return order_plat(world, call, a[0], order);
}

bool is_on_lift(const World& world, uint32_t sector) {
  for (const SectorMover& mover : world.state().movers.sectors)
    if (!mover.removed && mover.sector == sector && mover.kind == MoverKind::kPlat &&
        mover.type == kDownWaitUpStay)
      return true;
  return false;
}

void tic_plat(World& world, SectorMover& plat) {
  switch (plat.phase) {
    case MoverPhase::kUp:
      if (plat.type == kToggle) {  // in one go
        step_floor(world, plat.sector, INT32_MAX, plat.high,
                   world.sectors()[plat.sector].floor_height < plat.high, plat.crush);
        return arrive_up(world, plat);
      }
      switch (step_floor(world, plat.sector, plat.speed, plat.high, true, plat.crush)) {
        case PlaneStep::kBlocked:
          if (plat.crush < 0) {
            plat.left_tics = plat.wait_tics;
            plat.phase = MoverPhase::kDown;
          }
          return;
        case PlaneStep::kArrived:
          return arrive_up(world, plat);
        case PlaneStep::kMoved:
          return;
      }
      return;
    case MoverPhase::kDown:
      if (plat.type == kToggle) {
        step_floor(world, plat.sector, INT32_MAX, plat.low,
                   world.sectors()[plat.sector].floor_height < plat.low, plat.crush);
        return arrive_down(world, plat);
      }
      switch (step_floor(world, plat.sector, plat.speed, plat.low, false)) {
        case PlaneStep::kBlocked:
          if (plat.crush < 0) plat.phase = MoverPhase::kUp;
          return;
        case PlaneStep::kArrived:
          return arrive_down(world, plat);
        case PlaneStep::kMoved:
          return;
      }
      return;
    case MoverPhase::kWait:
      if (plat.left_tics > 0 && --plat.left_tics == 0)
        plat.phase =
            world.sectors()[plat.sector].floor_height == plat.low ? MoverPhase::kUp : MoverPhase::kDown;
      return;
    default:
      return;
  }
}

}  // namespace comrad::doom
