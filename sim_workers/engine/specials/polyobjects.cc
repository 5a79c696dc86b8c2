// Polyobjects: groups of lines that slide and turn as one. Their vertices live in the world.
#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/movers.h"

namespace comrad::doom {
namespace {

enum Motion : int32_t { kNone, kMove, kRotate, kDoorSlide, kDoorSwing };

constexpr int32_t kAnchor = 9300, kSpot = 9301, kSpotCrush = 9302, kSpotHurt = 9303;
// Hexen's own numbers. In Doom 3001 and 3002 are monsters, so that these count only beside an anchor 3000.
constexpr int32_t kHexenAnchor = 3000, kHexenSpot = 3001, kHexenSpotCrush = 3002;
constexpr int32_t kCrushDamage = 3;
constexpr int kMirrorsMax = 64;             // in one chain
constexpr Angle kByteAngleStep = 1u << 21;  // an eighth of 1/256 turn: unit of turning speeds

Polyobject* find_polyobject(World& world, int32_t number) {
  for (Polyobject& object : world.state().movers.polyobjects)
    if (object.number == number) return &object;
  return nullptr;
}

// ---------------------------------------------------------------- start

/// The lines of polyobject `number`: a closed chain from its start line, or those that name it.
std::vector<uint32_t> lines_of(const Level& level, int32_t number, int32_t& mirror) {
  std::vector<uint32_t> lines;
  const auto same_place = [&](uint32_t a, uint32_t b) {
    return level.vertices[a].x == level.vertices[b].x && level.vertices[a].y == level.vertices[b].y;
  };
  for (uint32_t first = 0; first < level.linedefs.size(); ++first) {
    const Linedef& start = level.linedefs[first];
    if (start.special != Special::kPolyobj_StartLine || start.args[0] != number) continue;
    mirror = start.args[1];
    lines.push_back(first);
    uint32_t end = start.end;
    while (!same_place(end, start.start)) {
      std::optional<uint32_t> next;
      for (uint32_t i = 0; i < level.linedefs.size() && !next; ++i)
        if (same_place(level.linedefs[i].start, end) &&
            std::find(lines.begin(), lines.end(), i) == lines.end())
          next = i;
      if (!next) break;
      lines.push_back(*next);
      end = level.linedefs[*next].end;
    }
    return lines;
  }
  for (uint32_t i = 0; i < level.linedefs.size(); ++i)
    if (level.linedefs[i].special == Special::kPolyobj_ExplicitLine && level.linedefs[i].args[0] == number)
      lines.push_back(i);
  std::stable_sort(lines.begin(), lines.end(), [&](uint32_t a, uint32_t b) {
    return level.linedefs[a].args[1] < level.linedefs[b].args[1];
  });
  if (!lines.empty()) mirror = level.linedefs[lines.front()].args[2];
  return lines;
}

/// Where the vertices are, from the anchor's place and the angle.
void renew_positions(Polyobject& object) {
  const Fixed sine = fine_sine(object.angle), cosine = fine_cosine(object.angle);
  for (std::size_t i = 0; i < object.vertices.size(); ++i) {
    const auto [x, y] = object.offset[i];
    // Turned ends lie on a grid of 1/128 unit, rounded down (measured).
    constexpr int64_t kGrid = ~int64_t{511};
    const int64_t turned_x =
        object.angle == 0 ? x : ((int64_t{x} * cosine - int64_t{y} * sine) >> kFracBits) & kGrid;
    const int64_t turned_y =
        object.angle == 0 ? y : ((int64_t{x} * sine + int64_t{y} * cosine) >> kFracBits) & kGrid;
    object.position[i] = {height_sum(object.x, turned_x), height_sum(object.y, turned_y)};
  }
}

std::optional<Polyobject> make_polyobject(const Level& level, const MapThing& spot, int32_t anchor_number) {
  const int32_t number = spot.angle_degrees;
  const MapThing* anchor = nullptr;
  for (const MapThing& thing : level.things)
    if (thing.editor_number == anchor_number && thing.angle_degrees == number) anchor = &thing;
  if (anchor == nullptr) return std::nullopt;
  Polyobject object;
  object.number = number;
  object.lines = lines_of(level, number, object.mirror);
  object.x = spot.x, object.y = spot.y;
  for (const uint32_t line : object.lines) {
    for (const uint32_t vertex : {level.linedefs[line].start, level.linedefs[line].end}) {
      if (std::find(object.vertices.begin(), object.vertices.end(), vertex) != object.vertices.end())
        continue;
      object.vertices.push_back(vertex);
      object.offset.push_back({height_sum(level.vertices[vertex].x, -int64_t{anchor->x}),
                               height_sum(level.vertices[vertex].y, -int64_t{anchor->y})});
    }
  }
  object.position.resize(object.vertices.size());
  renew_positions(object);
  return object;
}

// ---------------------------------------------------------------- in the way

/// Bodies that a line of the object runs into are pushed (and hurt by one that crushes). True where there
/// was one.
bool meets_bodies(World& world, std::size_t index) {
  WorldState& state = world.state();
  bool blocked = false;
  const std::size_t body_count = state.actors.size();
  // Most objects move where no body is.
  Box bounds = Box::nothing();
  for (const auto& [x, y] : state.movers.polyobjects[index].position) bounds.cover({x, x, y, y});
  bool near = false;
  for (const Actor& body : state.actors)
    near = near || Box::around(body.x, body.y, body.radius).overlaps(bounds);
  if (!near) return false;
  const std::size_t line_count = state.movers.polyobjects[index].lines.size();
  for (std::size_t i = 0; i < line_count; ++i) {
    const Polyobject& object = state.movers.polyobjects[index];
    const uint32_t line_index = object.lines[i];
    const Linedef& linedef = world.level().linedefs[line_index];
    BlockLine line = world.index().blockmap.lines()[line_index];
    for (std::size_t v = 0; v < object.vertices.size(); ++v) {
      if (object.vertices[v] == linedef.start)
        line.x1 = object.position[v][0], line.y1 = object.position[v][1];
      if (object.vertices[v] == linedef.end) line.x2 = object.position[v][0], line.y2 = object.position[v][1];
    }
    line.box = Box::around_ends(line.x1, line.y1, line.x2, line.y2);
    for (std::size_t slot = 0; slot < body_count; ++slot) {
      Actor& body = state.actors[slot];
      if (body.removed || !body.has(ActorFlag::kSolid) || body.has(ActorFlag::kNoClip) || body.is_corpse() ||
          body.has(ActorFlag::kNoInteraction))
        continue;
      const Box box = Box::around(body.x, body.y, body.radius);
      if (!line.box.overlaps(box) || !line.crosses(box)) continue;
      blocked = true;
      // Away from the side of the line that it touches.
      Angle angle = angle_to(line.x1, line.y1, line.x2, line.y2) - kAngle90;
      if (line.back_sector >= 0 && line.side_of(body.x, body.y) < 0) angle += kAngle180;
      Fixed force = kFracUnit;
      const bool turns = object.kind == kRotate || object.kind == kDoorSwing;
      if (object.kind != kNone) {
        const int64_t speed = turns ? int64_t{object.turn_speed} >> 8 : int64_t{object.speed} >> 3;
        force = static_cast<Fixed>(std::clamp<int64_t>(speed, kFracUnit, 4 * kFracUnit));
      }
      const Fixed push_x = fixed_mul(force, fine_cosine(angle)), push_y = fixed_mul(force, fine_sine(angle));
      constexpr int64_t kSpeedMax = to_fixed(1000);
      body.velocity_x =
          static_cast<Fixed>(std::clamp(int64_t{body.velocity_x} + push_x, -kSpeedMax, kSpeedMax));
      body.velocity_y =
          static_cast<Fixed>(std::clamp(int64_t{body.velocity_y} + push_y, -kSpeedMax, kSpeedMax));
      if (object.crush <= 0) continue;
      if (object.hurts_on_touch ||
          !Movement(world)
               .check_position(slot, height_sum(body.x, push_x), height_sum(body.y, push_y), false)
               .fits)
        damage_actor(world, body, nullptr, nullptr, object.crush, DamageType::kCrush);
    }
  }
  return blocked;
}

/// Moves and turns the object, unless a body is in the way.
bool shift(World& world, std::size_t index, Fixed dx, Fixed dy, Angle turn) {
  Polyobject& object = world.state().movers.polyobjects[index];
  const Fixed old_x = object.x, old_y = object.y;
  const Angle old_angle = object.angle;
  object.x = height_sum(object.x, dx), object.y = height_sum(object.y, dy);
  object.angle += turn;
  renew_positions(object);
  if (!meets_bodies(world, index)) return true;
  object.x = old_x, object.y = old_y, object.angle = old_angle;
  renew_positions(object);
  return false;
}

/// Length of a way of at most 16000 units an axis.
int64_t length_of(int64_t x, int64_t y) {
  const uint64_t square = static_cast<uint64_t>(x * x) + static_cast<uint64_t>(y * y);
  uint64_t root = 0;
  for (uint64_t bit = uint64_t{1} << 31; bit != 0; bit >>= 1)
    if ((root | bit) * (root | bit) <= square) root |= bit;
  return static_cast<int64_t>(root);
}

// ---------------------------------------------------------------- orders

/// Calls start(object, mirrored) for the polyobject and the chain of its mirrors; each other one goes the
/// opposite way. One on its way stays on it, unless `overrides`.
template <typename Start>
int32_t order_polyobject(World& world, int32_t number, bool overrides, Start start) {
  bool mirrored = false;
  for (int i = 0; i < kMirrorsMax && number != 0; ++i) {
    Polyobject* object = find_polyobject(world, number);
    if (object == nullptr || (object->kind != kNone && !overrides)) return i > 0 ? 1 : 0;
    object->closing = object->endless = object->has_target = false;
    object->left_tics = 0;
    start(*object, mirrored);
    mirrored = !mirrored;
    number = object->mirror;
  }
  return 1;
}

int32_t order_rotation(World& world, const SpecialCall& call, bool left, bool overrides) {
  const auto& a = call.args;  // number, speed, angle (0: a full turn, 255: for ever)
  return order_polyobject(world, a[0], overrides, [&](Polyobject& object, bool mirrored) {
    object.kind = kRotate;
    object.direction = left != mirrored ? 1 : 0;  // counter-clockwise or not
    object.turn_speed = static_cast<Angle>(std::clamp(a[1], 0, 1023)) * kByteAngleStep;
    object.endless = a[2] == 255;
    const bool full_turn = (a[2] & 255) == 0;
    object.turn_left = full_turn ? UINT32_MAX : byte_angle(a[2] & 255);
    object.distance_total = full_turn ? 1 : 0;
  });
}

int32_t order_move(World& world, const SpecialCall& call, int64_t unit, bool overrides) {
  const auto& a = call.args;  // number, speed, angle, distance
  return order_polyobject(world, a[0], overrides, [&](Polyobject& object, bool mirrored) {
    object.kind = kMove;
    object.speed = speed_of(a[1]);
    object.direction = byte_angle(a[2]) + (mirrored ? kAngle180 : 0);
    object.distance_left = object.distance_total = units(a[3] * unit);
  });
}

int32_t order_move_to(World& world, int32_t number, int32_t speed, Fixed x, Fixed y, bool overrides) {
  const Polyobject* first = find_polyobject(world, number);
  if (first == nullptr) return 0;
  const int64_t way_x = std::clamp<int64_t>(int64_t{x} - first->x, -to_fixed(16000), to_fixed(16000));
  const int64_t way_y = std::clamp<int64_t>(int64_t{y} - first->y, -to_fixed(16000), to_fixed(16000));
  return order_polyobject(world, number, overrides, [&](Polyobject& object, bool mirrored) {
    const int64_t sign = mirrored ? -1 : 1;
    object.kind = kMove;
    object.speed = speed_of(speed);
    object.target_x = height_sum(object.x, sign * way_x);
    object.target_y = height_sum(object.y, sign * way_y);
    object.has_target = true;
    object.direction = angle_to(object.x, object.y, object.target_x, object.target_y);
    const int64_t length = length_of(way_x, way_y);
    object.distance_left = object.distance_total = static_cast<Fixed>(std::min<int64_t>(length, INT32_MAX));
  });
}

int32_t order_move_to_spot(World& world, const SpecialCall& call, bool overrides) {
  const auto& a = call.args;  // number, speed, thing id
  if (const Actor* actor = world.find_thing(a[2]))
    return order_move_to(world, a[0], a[1], actor->x, actor->y, overrides);
  for (const MapThing& thing : world.level().things)
    if (thing.id == a[2] && a[2] != 0) return order_move_to(world, a[0], a[1], thing.x, thing.y, overrides);
  return 0;
}

int32_t order_slide(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // number, speed, angle, distance, wait
  return order_polyobject(world, a[0], false, [&](Polyobject& object, bool mirrored) {
    object.kind = kDoorSlide;
    object.speed = speed_of(a[1]);
    object.direction = byte_angle(a[2]) + (mirrored ? kAngle180 : 0);
    object.distance_left = object.distance_total = units(a[3]);
    object.wait_tics = wait_of(a[4]);
  });
}

int32_t order_swing(World& world, const SpecialCall& call) {
  const auto& a = call.args;  // number, speed, angle, wait
  return order_polyobject(world, a[0], false, [&](Polyobject& object, bool mirrored) {
    object.kind = kDoorSwing;
    object.direction = mirrored ? 0 : 1;
    object.turn_speed = static_cast<Angle>(std::clamp(a[1], 0, 1023)) * kByteAngleStep;
    object.turn_left = byte_angle(a[2] & 255);
    object.distance_total = a[2] & 255;  // the whole angle, for the way back
    object.wait_tics = wait_of(a[3]);
  });
}

// ---------------------------------------------------------------- each tic

void tic_move(World& world, std::size_t index) {
  const Polyobject& now = world.state().movers.polyobjects[index];
  const bool last = now.distance_left <= now.speed;
  const Fixed way = last ? now.distance_left : now.speed;
  Fixed dx = fixed_mul(way, fine_cosine(now.direction)), dy = fixed_mul(way, fine_sine(now.direction));
  if (now.has_target) {
    // Straight there, not by the table of angles; the end is set exactly.
    const int64_t left_x = int64_t{now.target_x} - now.x, left_y = int64_t{now.target_y} - now.y;
    const int64_t length = last ? 1 : std::max<int64_t>(length_of(left_x, left_y), 1);
    dx = height_sum(0, last ? left_x : left_x * way / length);
    dy = height_sum(0, last ? left_y : left_y * way / length);
  }
  if (!shift(world, index, dx, dy, 0)) return;
  Polyobject& object = world.state().movers.polyobjects[index];
  object.distance_left -= way;
  if (last) object.kind = kNone;
}

void tic_rotate(World& world, std::size_t index) {
  const Polyobject& now = world.state().movers.polyobjects[index];
  const bool last = !now.endless && now.turn_left <= now.turn_speed;
  const Angle turn = last ? now.turn_left : now.turn_speed;
  // A full turn does not fit its counter by one: the last step adds it, and the object is back exactly.
  const Angle exact = turn + (last && now.distance_total != 0 ? 1 : 0);
  if (!shift(world, index, 0, 0, now.direction == 1 ? exact : 0u - exact)) return;
  Polyobject& object = world.state().movers.polyobjects[index];
  if (object.endless) return;
  object.turn_left -= turn;
  if (last) object.kind = kNone;
}

/// The end of a door's way: it waits and comes back, or rests.
void end_door_way(Polyobject& door) {
  if (door.closing) {
    door.kind = kNone;
    return;
  }
  door.closing = true;
  door.left_tics = door.wait_tics;
  door.distance_left = door.distance_total;
  if (door.kind == kDoorSwing) door.turn_left = byte_angle(door.distance_total);
}

void tic_slide(World& world, std::size_t index) {
  const Polyobject& now = world.state().movers.polyobjects[index];
  const int32_t sign = now.closing ? -1 : 1;
  const Fixed dx = sign * fixed_mul(now.speed, fine_cosine(now.direction));
  const Fixed dy = sign * fixed_mul(now.speed, fine_sine(now.direction));
  const bool moved = now.distance_left <= 0 || shift(world, index, dx, dy, 0);
  Polyobject& door = world.state().movers.polyobjects[index];
  if (moved) {
    door.distance_left = height_sum(door.distance_left, -int64_t{door.speed});
    if (door.distance_left <= 0) end_door_way(door);
  } else if (door.crush < 0 && door.closing) {
    door.distance_left = door.distance_total - door.distance_left;
    door.closing = false;
  }
}

void tic_swing(World& world, std::size_t index) {
  const Polyobject& now = world.state().movers.polyobjects[index];
  const bool left = (now.direction == 1) != now.closing;
  const Angle turn = std::min(now.turn_speed, now.turn_left);
  const bool moved = now.turn_left == 0 || shift(world, index, 0, 0, left ? turn : 0u - turn);
  Polyobject& door = world.state().movers.polyobjects[index];
  if (moved) {
    door.turn_left -= turn;
    if (door.turn_left == 0) end_door_way(door);
  } else if (door.crush < 0 && door.closing) {
    door.turn_left = byte_angle(door.distance_total) - door.turn_left;
    door.closing = false;
  }
}

}  // namespace

std::optional<int32_t> execute_polyobject(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  switch (call.number) {
    case Special::kPolyobj_StartLine:
    case Special::kPolyobj_ExplicitLine:
      return 0;  // they say what belongs to a polyobject, and do nothing
    case Special::kPolyobj_RotateLeft:
    case Special::kPolyobj_RotateRight:
      return order_rotation(world, call, call.number == Special::kPolyobj_RotateLeft, false);
    case Special::kPolyobj_OR_RotateLeft:
    case Special::kPolyobj_OR_RotateRight:
      return order_rotation(world, call, call.number == Special::kPolyobj_OR_RotateLeft, true);
    case Special::kPolyobj_Move:
      return order_move(world, call, 1, false);
    case Special::kPolyobj_MoveTimes8:
      return order_move(world, call, 8, false);
    case Special::kPolyobj_OR_Move:
      return order_move(world, call, 1, true);
    case Special::kPolyobj_OR_MoveTimes8:
      return order_move(world, call, 8, true);
    case Special::kPolyobj_DoorSwing:
      return order_swing(world, call);
    case Special::kPolyobj_DoorSlide:
      return order_slide(world, call);
    case Special::kPolyobj_OR_MoveToSpot:
      return order_move_to_spot(world, call, true);
    case Special::kPolyobj_MoveToSpot:
      return order_move_to_spot(world, call, false);
    case Special::kPolyobj_Stop: {
      Polyobject* object = find_polyobject(world, a[0]);
      if (object == nullptr) return 0;
      object->kind = kNone;
      return 1;
    }
    case Special::kPolyobj_MoveTo:
    case Special::kPolyobj_OR_MoveTo:
      return order_move_to(world, a[0], a[1], units(a[2]), units(a[3]),
                           call.number == Special::kPolyobj_OR_MoveTo);
    default:
      return std::nullopt;
  }
}

void start_polyobjects(World& world) {
  const Level& level = world.level();
  std::vector<Polyobject>& objects = world.state().movers.polyobjects;
  for (const MapThing& thing : level.things) {
    const bool hexen = thing.editor_number == kHexenSpot || thing.editor_number == kHexenSpotCrush;
    if (!hexen && (thing.editor_number < kSpot || thing.editor_number > kSpotHurt)) continue;
    if (find_polyobject(world, thing.angle_degrees) != nullptr) continue;
    std::optional<Polyobject> object = make_polyobject(level, thing, hexen ? kHexenAnchor : kAnchor);
    if (!object || object->lines.empty()) {
      if (!hexen && world.index().warned_specials->first(Special::kPolyobj_StartLine))
        spdlog::warn("{}: polyobject {} has a start spot but no {}; it is left out", level.name,
                     thing.angle_degrees,
                     object ? "lines (special 1 or 5 with its number)" : "anchor (thing 9300 of that angle)");
      continue;
    }
    const bool crushes = thing.editor_number == kSpotCrush || thing.editor_number == kSpotHurt ||
                         thing.editor_number == kHexenSpotCrush;
    object->crush = crushes ? kCrushDamage : -1;
    object->hurts_on_touch = thing.editor_number == kSpotHurt;
    objects.push_back(std::move(*object));
  }
}

void tic_polyobjects(World& world) {
  std::vector<Polyobject>& objects = world.state().movers.polyobjects;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    Polyobject& object = objects[i];
    if (object.kind == kNone) continue;
    if (object.left_tics > 0) {
      --object.left_tics;
      continue;
    }
    switch (object.kind) {
      case kMove:
        tic_move(world, i);
        break;
      case kRotate:
        tic_rotate(world, i);
        break;
      case kDoorSlide:
        tic_slide(world, i);
        break;
      case kDoorSwing:
        tic_swing(world, i);
        break;
      default:
        break;
    }
  }
}

bool polyobject_is_moving(const World& world, int32_t number) {
  for (const Polyobject& object : world.state().movers.polyobjects)
    if (object.number == number) return object.kind != kNone;
  return false;
}

}  // namespace comrad::doom
