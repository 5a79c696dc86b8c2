// Doors: ceilings that open up to 4 units below the lowest ceiling around, and close.
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

enum DoorType : int32_t { kRaise, kOpen, kCloseWaitOpen, kClose, kWaitRaise, kWaitClose };

constexpr Fixed kDoorGap = to_fixed(4);  // between an open door and the lowest ceiling around
constexpr Fixed kDoorSpeed = to_fixed(2);
constexpr int32_t kDoorWaitTics = 150;
// Sector types of doors that move once at the start of the map.
constexpr int32_t kTypeCloseIn30 = 74, kTypeRaiseIn5Minutes = 78;

struct DoorOrder {
  DoorType type = kRaise;
  Fixed speed = 0;
  int32_t wait_tics = 0;
  int32_t lock = 0;
  int32_t light_tag = 0;
  int32_t first_wait_tics = 0;  // of kWaitRaise and kWaitClose
  bool remote_rules = false;    // a generic door does not turn round when it is used again
};

/// Quirks of ViZDoom's: a door closes onto the floor where it is now, unless a lift has moved that (Plat_DownWaitUpStay). A
/// door that starts on such a lift closes onto its own ceiling until the floor changes without one.
void look_for_floor(const World& world, SectorMover& door) {
  const Fixed floor = world.sectors()[door.sector].floor_height;
  if (door.low_2 == floor || is_on_lift(world, door.sector)) return;
  door.low = door.low_2 = floor;
}

void start_door(World& world, uint32_t sector, const DoorOrder& order) {
  SectorMover door;
  door.sector = sector;
  door.kind = MoverKind::kDoor;
  door.type = order.type;
  door.speed = order.speed;
  door.wait_tics = order.wait_tics;
  door.light_tag = order.light_tag;
  const Sector& own = world.sectors()[sector];
  door.low_2 = own.floor_height;  // as the door saw it last
  door.low = is_on_lift(world, sector) ? own.ceiling_height : own.floor_height;
  const Fixed open = height_sum(lowest_ceiling_around(world, sector), -int64_t{kDoorGap});
  door.high = order.type == kCloseWaitOpen ? own.ceiling_height : open;
  switch (order.type) {
    case kRaise:
    case kOpen:
      door.phase = MoverPhase::kUp;
      break;
    case kClose:
    case kCloseWaitOpen:
      door.phase = MoverPhase::kDown;
      break;
    case kWaitRaise:
    case kWaitClose:
      door.phase = MoverPhase::kInitialWait;
      door.left_tics = order.first_wait_tics;
      break;
  }
  start_mover(world, door);
}

/// A door used by hand: the sector behind the line. One that moves already turns round.
int32_t use_door(World& world, const SpecialCall& call, const DoorOrder& order) {
  if (!has_line(world, call)) return 0;
  const Linedef& line = world.level().linedefs[static_cast<std::size_t>(call.line)];
  if (!line.back) return 0;
  const uint32_t sector = world.level().sidedefs[*line.back].sector_index;
  if (!is_busy(world, sector, kCeilingPlane)) {
    start_door(world, sector, order);
    return 1;
  }
  SectorMover* door = find_mover(world, sector, kCeilingPlane);
  if (order.remote_rules || door == nullptr || door->kind != MoverKind::kDoor || door->type != kRaise ||
      order.type != kRaise)
    return 0;
  if (door->phase == MoverPhase::kDown) {
    door->phase = MoverPhase::kUp;
    return 1;
  }
  if (call.activator == nullptr || call.activator->player_index < 0) return 0;  // monsters never shut doors
  door->phase = MoverPhase::kDown;
  return 1;
}

int32_t order_door(World& world, const SpecialCall& call, int32_t tag, const DoorOrder& order) {
  if (order.lock != 0 && (call.activator == nullptr || !has_key(world, *call.activator, order.lock)))
    return 0;
  if (tag == 0) return use_door(world, call, order);
  return for_each_target(world, call, tag, [&](uint32_t sector) {
    if (is_busy(world, sector, kCeilingPlane)) return false;
    start_door(world, sector, order);
    return true;
  });
}

/// A door that sheds light shows how far it is open.
void renew_door_light(World& world, const SectorMover& door) {
  if (door.light_tag == 0) return;
  const int64_t way = int64_t{door.high} - door.low;
  const int64_t open = int64_t{world.sectors()[door.sector].ceiling_height} - door.low;
  set_light_part_way(
      world, door.light_tag,
      way <= 0 ? kFracUnit : static_cast<Fixed>(std::clamp<int64_t>(open, 0, way) * kFracUnit / way));
}

}  // namespace

std::optional<int32_t> execute_door(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  DoorOrder order;
  order.speed = speed_of(a[1]);
  switch (call.number) {
    case Special::kDoor_Close:  // tag, speed, light tag
      order.type = kClose, order.light_tag = a[2];
      break;
    case Special::kDoor_Open:
      order.type = kOpen, order.light_tag = a[2];
      break;
    case Special::kDoor_Raise:  // tag, speed, wait, light tag
      order.type = kRaise, order.wait_tics = wait_of(a[2]), order.light_tag = a[3];
      break;
    case Special::kDoor_LockedRaise:  // tag, speed, wait, lock, light tag
      order.type = a[2] != 0 ? kRaise : kOpen;
      order.wait_tics = wait_of(a[2]), order.lock = a[3], order.light_tag = a[4];
      break;
    case Special::kDoor_Animated:  // tag, speed, wait, lock; its pictures are not ours
      order.type = a[2] != 0 ? kRaise : kOpen;
      order.wait_tics = wait_of(a[2]), order.lock = a[3];
      break;
    case Special::kDoor_WaitRaise:  // tag, speed, wait, first wait, light tag
      order.type = kWaitRaise, order.wait_tics = wait_of(a[2]);
      order.first_wait_tics = wait_of(a[3]), order.light_tag = a[4];
      break;
    case Special::kDoor_WaitClose:  // tag, speed, first wait, light tag
      order.type = kWaitClose, order.first_wait_tics = wait_of(a[2]), order.light_tag = a[3];
      break;
    case Special::kGeneric_Door: {  // tag, speed, kind, wait in octics, lock
      constexpr DoorType kKinds[] = {kRaise, kOpen, kCloseWaitOpen, kClose};
      const int32_t kind = a[2] & 127;
      if (kind > 3) return 0;
      order.type = kKinds[kind];
      order.wait_tics = octics(a[3]), order.lock = a[4], order.remote_rules = true;
      const bool tag_is_light = (a[2] & 128) != 0;
      order.light_tag = tag_is_light ? a[0] : 0;
      return order_door(world, call, tag_is_light ? 0 : a[0], order);
    }
    case Special::kDoor_CloseWaitOpen:  // tag, speed, wait in octics, light tag
      order.type = kCloseWaitOpen, order.wait_tics = octics(a[2]), order.light_tag = a[3];
      break;
    default:
      return std::nullopt;
  }
  return order_door(world, call, a[0], order);
}

void start_doors(World& world) {
  for (uint32_t index = 0; index < world.sectors().size(); ++index) {
    Sector& sector = world.state().sectors[index];
    const int32_t type = sector.special & kTypeMask;
    if (type != kTypeCloseIn30 && type != kTypeRaiseIn5Minutes) continue;
    sector.special &= ~kTypeMask;
    DoorOrder order;
    order.type = type == kTypeCloseIn30 ? kWaitClose : kWaitRaise;
    order.speed = kDoorSpeed, order.wait_tics = kDoorWaitTics;
    order.first_wait_tics = type == kTypeCloseIn30 ? 30 * 35 : 5 * 60 * 35;
    start_door(world, index, order);
  }
}

void tic_door(World& world, SectorMover& door) {
  look_for_floor(world, door);
  switch (door.phase) {
    case MoverPhase::kInitialWait:
      if (--door.left_tics > 0) return;
      door.phase = door.type == kWaitClose ? MoverPhase::kDown : MoverPhase::kUp;
      door.type = door.type == kWaitClose ? kClose : kRaise;
      return;
    case MoverPhase::kWait:
      // A wait of no tics never ends.
      if (door.left_tics > 0 && --door.left_tics == 0)
        door.phase = door.type == kCloseWaitOpen ? MoverPhase::kUp : MoverPhase::kDown;
      return;
    case MoverPhase::kDown:
      switch (step_ceiling(world, door.sector, door.speed, door.low, false)) {
        case PlaneStep::kArrived:
          if (door.type == kCloseWaitOpen) {
            door.phase = MoverPhase::kWait;
            door.left_tics = door.wait_tics;
          } else {
            stop_mover(world, door);
          }
          break;
        case PlaneStep::kBlocked:
          if (door.type != kClose) door.phase = MoverPhase::kUp;  // Door_Close continues trying
          break;
        case PlaneStep::kMoved:
          break;
      }
      return renew_door_light(world, door);
    case MoverPhase::kUp:
      if (step_ceiling(world, door.sector, door.speed, door.high, true) == PlaneStep::kArrived) {
        if (door.type == kRaise) {
          door.phase = MoverPhase::kWait;
          door.left_tics = door.wait_tics;
        } else {
          stop_mover(world, door);
        }
      }
      return renew_door_light(world, door);
    default:
      return;
  }
}

}  // namespace comrad::doom
