// Textures that scroll, floors that carry, wind and currents, and what else changes the nature of a sector.
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/sight.h"
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/sector_bodies.h"

namespace comrad::doom {
namespace {

constexpr Fixed kCarryFactor = kFracUnit * 3 / 32;  // with friction this brings bodies to the belt's speed
constexpr Fixed kSlowCarry =
    kStopSpeed * 32 / 3;              // slower belts move bodies themselves: friction would stop them
constexpr int32_t kPushBit = 0x1000;  // of a sector's special: wind and currents are felt there
constexpr int kPushShift = 7;         // wind and currents: 128ths of a unit per tic
constexpr int kLineScrollShift = 5;   // a line as a speed: 32nds of its length
constexpr int32_t kPusherThing = 5001, kPullerThing = 5002;

// How a Scroller of kind kWind (`part`).
enum WindPart : int32_t { kWindSector, kCurrent, kThrust };

Fixed wrap_add(Fixed a, Fixed b) {
  return static_cast<Fixed>(static_cast<uint32_t>(a) + static_cast<uint32_t>(b));
}

/// Sets the speed of a scroller; one of no speed is left out.
void set_scroller(World& world, ScrollKind kind, uint32_t index, int32_t part, Fixed dx, Fixed dy) {
  std::vector<Scroller>& scrollers = world.state().movers.scrollers;
  const auto same = [&](const Scroller& scroller) {
    return scroller.kind == kind && scroller.index == index &&
           (kind == ScrollKind::kSide || kind == ScrollKind::kPoint || scroller.part == part);
  };
  const auto found = std::find_if(scrollers.begin(), scrollers.end(), same);
  const Scroller scroller{.kind = kind, .index = index, .dx = dx, .dy = dy, .part = part};
  if (dx == 0 && dy == 0) {
    if (found != scrollers.end()) scrollers.erase(found);
  } else if (found != scrollers.end()) {
    *found = scroller;
  } else {
    scrollers.push_back(scroller);
  }
}

/// 64ths of a unit per tic.
Fixed texture_speed(int64_t arg) {
  return static_cast<Fixed>(std::clamp<int64_t>(arg, -65536, 65536) * (kFracUnit / 64));
}

template <typename Visit>
int32_t for_each_line_with_id(World& world, int32_t id, Visit visit) {
  const auto lines = world.lines();
  for (uint32_t i = 0; i < lines.size(); ++i)
    if (lines[i].id == id) visit(i);
  return 1;
}

void scroll_line(World& world, uint32_t line, bool back, int32_t part, Fixed dx, Fixed dy) {
  const Linedef& linedef = world.level().linedefs[line];
  if (!back) set_scroller(world, ScrollKind::kSide, linedef.front, part, dx, dy);
  if (back && linedef.back) set_scroller(world, ScrollKind::kSide, *linedef.back, part, dx, dy);
}

/// The calling line as a vector.
std::optional<std::array<Fixed, 2>> line_vector(const World& world, const SpecialCall& call) {
  if (!has_line(world, call)) return std::nullopt;
  const Linedef& line = world.level().linedefs[static_cast<std::size_t>(call.line)];
  const Vertex &start = world.level().vertices[line.start], &end = world.level().vertices[line.end];
  return std::array<Fixed, 2>{clamped_fixed(int64_t{end.x} - start.x),
                              clamped_fixed(int64_t{end.y} - start.y)};
}

int32_t scroll_plane(World& world, const SpecialCall& call, bool of_floor) {
  const auto& a = call.args;
  constexpr Fixed kUnit = kFracUnit / 32;
  const auto speed = [](int64_t units) {
    return static_cast<Fixed>(std::clamp<int64_t>(units, -65536, 65536) * kUnit);
  };
  // A script: tag, x, y, mode. A line: tag, bits (4: the line's vector), mode, x + 128, y + 128.
  const bool from_line = call.line >= 0;
  Fixed dx = from_line ? speed(int64_t{a[3]} - 128) : speed(a[1]);
  Fixed dy = from_line ? speed(int64_t{a[4]} - 128) : speed(a[2]);
  if (from_line && (a[1] & 4) != 0) {
    const auto vector = line_vector(world, call);
    if (!vector) return 0;
    dx = (*vector)[0] >> kLineScrollShift, dy = (*vector)[1] >> kLineScrollShift;
  }
  const int32_t mode = !of_floor ? 0 : from_line ? a[2] : a[3];  // 0 texture, 1 carry, 2 both
  for_each_tagged_sector(world, a[0], [&](uint32_t sector) {
    if (mode == 0 || mode == 2)
      set_scroller(world, of_floor ? ScrollKind::kFloor : ScrollKind::kCeiling, sector, 0, -dx, dy);
    if (mode == 1 || mode == 2) set_scroller(world, ScrollKind::kCarry, sector, 0, dx, dy);
  });
  return 1;
}

int32_t set_wind(World& world, const SpecialCall& call, WindPart part) {
  const auto& a = call.args;  // tag, strength, angle, use the line's vector
  const int64_t strength = std::clamp(a[1], -32767, 32767);
  Fixed dx = static_cast<Fixed>((strength * fine_cosine(byte_angle(a[2]))) >> kPushShift);
  Fixed dy = static_cast<Fixed>((strength * fine_sine(byte_angle(a[2]))) >> kPushShift);
  if (a[3] != 0) {
    if (const auto vector = line_vector(world, call))
      dx = (*vector)[0] >> kPushShift, dy = (*vector)[1] >> kPushShift;
  }
  for_each_tagged_sector(
      world, a[0], [&](uint32_t sector) { set_scroller(world, ScrollKind::kWind, sector, part, dx, dy); });
  return 1;
}

int32_t set_point_push(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // tag, thing id, strength, use the line's length
  int32_t strength = std::clamp(a[2], -32767, 32767);
  if (a[3] != 0) {
    if (const auto vector = line_vector(world, call))
      strength = approximate_distance((*vector)[0] / 2, (*vector)[1] / 2) / (kFracUnit / 2);
  }
  const auto& things = world.level().things;
  for (uint32_t i = 0; i < things.size(); ++i) {
    if (things[i].editor_number != kPusherThing && things[i].editor_number != kPullerThing) continue;
    const bool wanted = a[0] != 0 ? world.sectors()[world.sector_at(things[i].x, things[i].y)].tag == a[0]
                                  : things[i].id == a[1];
    if (wanted) set_scroller(world, ScrollKind::kPoint, i, 0, strength, 0);
  }
  return 1;
}

/// Ice and mud: `amount` 100 is plain ground, less is sticky.
int32_t set_friction(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // tag, amount, use the line's length
  int64_t amount = std::clamp(a[1], 0, 255);
  if (amount == 0) {
    const auto vector = line_vector(world, call);
    if (!vector) return 0;
    amount = approximate_distance((*vector)[0] / 2, (*vector)[1] / 2) / (kFracUnit / 2);
  }
  amount = std::clamp<int64_t>(amount, 0, 2000);
  // Linear in the amount: 100 gives 0xE800, 200 nearly none; how well feet grip follows from it.
  const int64_t friction = std::clamp<int64_t>((0x1EB8 * amount) / 0x80 + 0xD001, 0, kFracUnit);
  const int64_t grip = friction >= kSectorFriction ? (0x10092 - friction) * 1024 / 4352 + 568
                                                   : (friction - 0xDB34) * 0xA / 0x80;
  for_each_tagged_sector(world, a[0], [&](uint32_t index) {
    Sector& sector = world.state().sectors[index];
    sector.friction = static_cast<Fixed>(friction);
    sector.move_factor = static_cast<int32_t>(std::max<int64_t>(grip, 32));
    sector.special_friction = world.state().has_special_friction = true;
  });
  return 1;
}

/// A flat moved by whole units and hundredths.
int32_t set_panning(World& world, const SpecialCall& call, FlatPlacement Sector::*plane) {
  const auto& a = call.args;  // tag, x, x in 100ths, y, y in 100ths
  const auto offset = [](int32_t whole, int32_t hundredths) {
    return height_sum(units(whole), int64_t{std::clamp(hundredths, -100000, 100000)} * kFracUnit / 100);
  };
  for_each_tagged_sector(world, a[0], [&](uint32_t index) {
    FlatPlacement& flat = world.state().sectors[index].*plane;
    flat.offset_x = offset(a[1], a[2]), flat.offset_y = offset(a[3], a[4]);
  });
  return 1;
}

/// A scale of 2 shows the flat at half size.
int32_t set_scale(World& world, const SpecialCall& call, FlatPlacement Sector::*plane) {
  const auto& a = call.args;  // tag, x, x in 100ths, y, y in 100ths; 0: as it is
  const auto scale = [](int32_t whole, int32_t hundredths) {
    return static_cast<float>(int64_t{whole} * 100 + hundredths) / 100.0f;
  };
  for_each_tagged_sector(world, a[0], [&](uint32_t index) {
    FlatPlacement& flat = world.state().sectors[index].*plane;
    if (a[1] != 0 || a[2] != 0) flat.scale_x = 1.0f / scale(a[1], a[2]);
    if (a[3] != 0 || a[4] != 0) flat.scale_y = 1.0f / scale(a[3], a[4]);
  });
  return 1;
}

// ---------------------------------------------------------------- sector types

constexpr int32_t kTypeWind = 40, kTypeEastLava = 84, kTypeScroll = 201, kTypeCarry = 225,
                  kTypeCarryEnd = 245;

/// Winds, belts and streams of sector types.
void start_sector_type(World& world, uint32_t index) {
  const int32_t type = world.sectors()[index].special & kTypeMask;
  const auto belt = [&](Fixed dx, Fixed dy) {
    set_scroller(world, ScrollKind::kFloor, index, 0, -dx, dy);
    set_scroller(world, ScrollKind::kCarry, index, 0, dx, dy);
  };
  if (type >= kTypeWind && type < kTypeWind + 12) {  // east, north, south, west, each weak, medium, strong
    constexpr int32_t kDirections[4][2] = {{1, 0}, {0, 1}, {0, -1}, {-1, 0}};
    constexpr Fixed kStrengths[3] = {5, 10, 25};  // 32nds of a unit per tic
    const auto& direction = kDirections[(type - kTypeWind) / 3];
    const Fixed strength = kStrengths[(type - kTypeWind) % 3] * (kFracUnit / 32);
    set_scroller(world, ScrollKind::kWind, index, kThrust, direction[0] * strength, direction[1] * strength);
  } else if (type == kTypeEastLava) {
    belt(28 * kFracUnit / 3, 0);
  } else if (type >= kTypeScroll && type < kTypeScroll + 24) {  // eight directions, each slow, medium, fast
    constexpr int32_t kDirections[8][2] = {{0, 1},  {1, 0}, {0, -1}, {-1, 0},
                                           {-1, 1}, {1, 1}, {1, -1}, {-1, -1}};
    const auto& direction = kDirections[(type - kTypeScroll) / 3];
    const Fixed speed = (kFracUnit / 2) << ((type - kTypeScroll) % 3);
    belt(direction[0] * speed, direction[1] * speed);
  } else if (type >= kTypeCarry && type < kTypeCarryEnd) {  // east, north, south, west, five speeds each
    constexpr int32_t kDirections[4][2] = {{1, 0}, {0, 1}, {0, -1}, {-1, 0}};
    constexpr Fixed kStrengths[5] = {5, 10, 25, 30, 35};  // thirds of a unit per tic
    const auto& direction = kDirections[(type - kTypeCarry) / 5];
    const Fixed speed = kStrengths[(type - kTypeCarry) % 5] * kFracUnit / 3;
    belt(direction[0] * speed, direction[1] * speed);
  }
}

// ---------------------------------------------------------------- each tic

void push_body(Actor& body, int64_t dx, int64_t dy) {
  constexpr int64_t kMax = to_fixed(1000);
  body.velocity_x = static_cast<Fixed>(std::clamp(body.velocity_x + dx, -kMax, kMax));
  body.velocity_y = static_cast<Fixed>(std::clamp(body.velocity_y + dy, -kMax, kMax));
}

/// A belt: sets everything on its floor into motion.
void carry(World& world, const Scroller& belt) {
  const Fixed floor = world.sectors()[belt.index].floor_height;
  // Along each axis by itself (measured: Scroll_Floor(tag, 21, 22, 1)).
  const bool slow_x = std::abs(belt.dx) <= kSlowCarry, slow_y = std::abs(belt.dy) <= kSlowCarry;
  const Fixed step_x = slow_x ? belt.dx : 0, step_y = slow_y ? belt.dy : 0;
  const Fixed push_x = slow_x ? 0 : fixed_mul(belt.dx, kCarryFactor);
  const Fixed push_y = slow_y ? 0 : fixed_mul(belt.dy, kCarryFactor);
  WorldState& state = world.state();
  const std::size_t count = state.actors.size();
  for (std::size_t slot = 0; slot < count; ++slot) {
    Actor& body = state.actors[slot];
    if (body.removed || body.z > floor || body.has(ActorFlag::kNoClip) || body.has(ActorFlag::kNoSector) ||
        body.has(ActorFlag::kNoGravity) || body.has(ActorFlag::kNoInteraction))
      continue;
    if (!touches_sector(world, body, belt.index)) continue;
    push_body(body, push_x, push_y);
    if (step_x != 0 || step_y != 0)
      Movement(world).try_move(slot, wrap_add(body.x, step_x), wrap_add(body.y, step_y));
  }
}

/// Wind and currents push players.
void blow(World& world, const Scroller& wind) {
  for (int player = 0; player < world.player_count(); ++player) {
    Actor* body = world.body_of(player);
    if (body == nullptr || body->removed || body->has(ActorFlag::kNoClip)) continue;
    if (wind.part == kThrust) {
      if (body->sector_index == wind.index) push_body(*body, wind.dx, wind.dy);
      continue;
    }
    if ((world.sectors()[wind.index].special & kPushBit) == 0 || !touches_sector(world, *body, wind.index))
      continue;
    const bool on_floor = body->z <= world.sectors()[wind.index].floor_height;
    if (wind.part == kCurrent) {
      if (on_floor) push_body(*body, wind.dx, wind.dy);
    } else {
      push_body(*body, on_floor ? wind.dx / 2 : wind.dx, on_floor ? wind.dy / 2 : wind.dy);
    }
  }
}

/// A thing that pushes players away or pulls them, the stronger the nearer.
void push_from_point(World& world, const Scroller& point) {
  const MapThing& thing = world.level().things[point.index];
  const int64_t strength = point.dx;
  const uint32_t sector = world.sector_at(thing.x, thing.y);
  for (int player = 0; player < world.player_count(); ++player) {
    Actor* body = world.body_of(player);
    if (body == nullptr || body->removed || body->has(ActorFlag::kNoClip)) continue;
    if (std::abs(int64_t{body->x} - thing.x) >= to_fixed(16000) ||
        std::abs(int64_t{body->y} - thing.y) >= to_fixed(16000))
      continue;
    const Fixed distance = approximate_distance(body->x - thing.x, body->y - thing.y);
    // In units per tic: strength less half the distance, over 256.
    const int64_t speed = (strength * kFracUnit - distance / 2) >> (kPushShift + 1);
    if (speed <= 0) continue;
    Actor spot;
    spot.x = thing.x, spot.y = thing.y, spot.z = world.sectors()[sector].floor_height;
    spot.sector_index = sector, spot.height = to_fixed(16);
    if (!can_see(world, *body, spot)) continue;
    Angle angle = angle_to(body->x, body->y, thing.x, thing.y);
    if (thing.editor_number == kPusherThing) angle += kAngle180;
    push_body(*body, (speed * fine_cosine(angle)) >> kFracBits, (speed * fine_sine(angle)) >> kFracBits);
  }
}

}  // namespace

std::optional<int32_t> execute_scroller(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  const auto own_line = [&](Fixed dx, Fixed dy) -> int32_t {
    if (!has_line(world, call)) return 0;
    scroll_line(world, static_cast<uint32_t>(call.line), call.back_side, a[1], dx, dy);
    return 1;
  };
  switch (call.number) {
    case Special::kScroll_Wall: {  // line id, x, y (16.16 per tic), side, parts
      return for_each_line_with_id(
          world, a[0], [&](uint32_t line) { scroll_line(world, line, a[3] != 0, a[4], a[1], a[2]); });
    }
    case Special::kSector_ChangeFlags: {  // tag, set, clear
      for_each_tagged_sector(world, a[0], [&](uint32_t index) {
        Sector& sector = world.state().sectors[index];
        const auto change = [&](int32_t bit, bool& flag) {
          flag = (flag || (a[1] & bit) != 0) && (a[2] & bit) == 0;
        };
        change(1, sector.silent), change(2, sector.no_falling_damage), change(16, sector.special_friction);
        world.state().has_special_friction |= sector.special_friction;
      });
      return 1;
    }
    case Special::kScroll_Texture_Left:  // speed in 64ths, parts
      return own_line(texture_speed(a[0]), 0);
    case Special::kScroll_Texture_Right:
      return own_line(-texture_speed(a[0]), 0);
    case Special::kScroll_Texture_Up:
      return own_line(0, texture_speed(a[0]));
    case Special::kScroll_Texture_Down:
      return own_line(0, -texture_speed(a[0]));
    case Special::kSector_SetCeilingPanning:
      return set_panning(world, call, &Sector::ceiling_placement);
    case Special::kSector_SetFloorPanning:
      return set_panning(world, call, &Sector::floor_placement);
    case Special::kSector_SetCeilingScale:
      return set_scale(world, call, &Sector::ceiling_placement);
    case Special::kSector_SetFloorScale:
      return set_scale(world, call, &Sector::floor_placement);
    case Special::kSector_SetRotation:  // tag, floor, ceiling, in degrees
      for_each_tagged_sector(world, a[0], [&](uint32_t index) {
        Sector& sector = world.state().sectors[index];
        sector.floor_placement.rotation_degrees = static_cast<float>(a[1] % 360);
        sector.ceiling_placement.rotation_degrees = static_cast<float>(a[2] % 360);
      });
      return 1;
    case Special::kSector_SetWind:
      return set_wind(world, call, kWindSector);
    case Special::kSector_SetFriction:
      return set_friction(world, call);
    case Special::kSector_SetCurrent:
      return set_wind(world, call, kCurrent);
    case Special::kScroll_Texture_Both: {  // line id (0: its own), left, right, down, up
      const Fixed dx = texture_speed(int64_t{a[1]} - a[2]), dy = texture_speed(int64_t{a[4]} - a[3]);
      if (a[0] != 0)
        return for_each_line_with_id(world, a[0],
                                     [&](uint32_t line) { scroll_line(world, line, false, 0, dx, dy); });
      if (!has_line(world, call)) return 0;
      scroll_line(world, static_cast<uint32_t>(call.line), call.back_side, 0, dx, dy);
      return 1;
    }
    case Special::
        kScroll_Texture_Model: {  // line id, bits; by the calling line's vector along each of the lines
      const auto vector = line_vector(world, call);
      if (!vector) return 0;
      return for_each_line_with_id(world, a[0], [&](uint32_t line) {
        if (static_cast<int32_t>(line) == call.line) return;
        const Linedef& linedef = world.level().linedefs[line];
        const Vertex &start = world.level().vertices[linedef.start],
                     &end = world.level().vertices[linedef.end];
        const Angle angle = angle_to(start.x, start.y, end.x, end.y);
        const int64_t x = (*vector)[0] >> kLineScrollShift, y = (*vector)[1] >> kLineScrollShift;
        const int64_t along = (x * fine_cosine(angle) + y * fine_sine(angle)) >> kFracBits;
        const int64_t across = (y * fine_cosine(angle) - x * fine_sine(angle)) >> kFracBits;
        scroll_line(world, line, false, 0, static_cast<Fixed>(-along), static_cast<Fixed>(across));
      });
    }
    case Special::kScroll_Floor:
      return scroll_plane(world, call, true);
    case Special::kScroll_Ceiling:
      return scroll_plane(world, call, false);
    case Special::kScroll_Texture_Offsets: {  // by the front side's own offsets
      if (!has_line(world, call)) return 0;
      const Linedef& line = world.level().linedefs[static_cast<std::size_t>(call.line)];
      const Sidedef& side = world.level().sidedefs[line.front];
      scroll_line(world, static_cast<uint32_t>(call.line), false, 0, -units(side.offset_x),
                  units(side.offset_y));
      return 1;
    }
    case Special::kPointPush_SetForce:
      return set_point_push(world, call);
    default:
      return std::nullopt;
  }
}

void start_scrollers(World& world) {
  for (uint32_t index = 0; index < world.sectors().size(); ++index) start_sector_type(world, index);
  // Lines that say once how their sides, sectors or things behave.
  const auto is_static = [](int32_t special) {
    return (special >= Special::kScroll_Texture_Left && special <= Special::kScroll_Texture_Down) ||
           (special >= Special::kSector_SetWind && special <= Special::kScroll_Texture_Offsets) ||
           special == Special::kPointPush_SetForce;
  };
  for (uint32_t index = 0; index < world.lines().size(); ++index) {
    LineState& line = world.state().lines[index];
    if (!is_static(line.special)) continue;
    SpecialCall call;
    call.number = line.special, call.args = line.args, call.line = static_cast<int32_t>(index);
    line.special = 0;
    execute_scroller(world, call);
  }
}

void carry_bodies(World& world) {
  const auto& scrollers = world.state().movers.scrollers;
  for (std::size_t i = 0, count = scrollers.size(); i < count && i < scrollers.size(); ++i)
    if (const Scroller scroller = scrollers[i]; scroller.kind == ScrollKind::kCarry) carry(world, scroller);
}

void tic_scrollers(World& world, std::size_t first) {
  WorldState& state = world.state();
  const std::size_t count = state.movers.scrollers.size();
  // By index: a body that is carried may cross a line whose special changes the list.
  for (std::size_t i = first; i < count && i < state.movers.scrollers.size(); ++i) {
    const Scroller scroller = state.movers.scrollers[i];
    switch (scroller.kind) {
      case ScrollKind::kSide: {
        SideState& side = state.sides[scroller.index];
        side.scroll_x = wrap_add(side.scroll_x, scroller.dx);
        side.scroll_y = wrap_add(side.scroll_y, scroller.dy);
        break;
      }
      case ScrollKind::kFloor:
      case ScrollKind::kCeiling: {
        Sector& sector = state.sectors[scroller.index];
        FlatPlacement& flat =
            scroller.kind == ScrollKind::kFloor ? sector.floor_placement : sector.ceiling_placement;
        flat.offset_x = wrap_add(flat.offset_x, scroller.dx);
        flat.offset_y = wrap_add(flat.offset_y, scroller.dy);
        break;
      }
      case ScrollKind::kCarry:
        break;  // before the bodies move: carry_bodies()
      case ScrollKind::kWind:
        blow(world, scroller);
        break;
      case ScrollKind::kPoint:
        push_from_point(world, scroller);
        break;
    }
  }
}

}  // namespace comrad::doom
