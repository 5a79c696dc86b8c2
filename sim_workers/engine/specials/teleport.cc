// Teleporters: where they lead, who stands there, and what the journey does to a body.
#include <algorithm>
#include <cstdlib>
#include <string_view>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/specials/special_families.h"

namespace comrad::doom {
namespace {

constexpr int32_t kDestinationThing = 14, kDestinationWithGravity = 9043, kDestinationInAir = 9044;
constexpr int32_t kFreezeTics = 18;  // a player just teleported stands still
constexpr int kNudges = 10;

struct Destination {
  Fixed x = 0, y = 0;
  Fixed z = kOnFloor;
  Angle angle = 0;
};

enum class Turn : uint8_t { kToDestination, kKeep, kByLine };

struct Journey {
  bool source_fog = true, destination_fog = true;
  bool keep_velocity = false, keep_height = false;
  Turn turn = Turn::kToDestination;
  Angle line_angle = 0;
};

Angle line_angle(const World& world, int32_t line) {
  const Linedef& linedef = world.level().linedefs[static_cast<std::size_t>(line)];
  const Vertex &start = world.level().vertices[linedef.start], &end = world.level().vertices[linedef.end];
  return angle_to(start.x, start.y, end.x, end.y);
}

void turn_velocity(Actor& actor, Angle by) {
  const Fixed sine = fine_sine(by), cosine = fine_cosine(by);
  const Fixed x = actor.velocity_x, y = actor.velocity_y;
  // Each product rounded by itself, as in ViZDoom.
  actor.velocity_x = clamped_fixed(int64_t{fixed_mul(x, cosine)} - fixed_mul(y, sine));
  actor.velocity_y = clamped_fixed(int64_t{fixed_mul(x, sine)} + fixed_mul(y, cosine));
}

// ---------------------------------------------------------------- where to

/// One of the things with that id, drawn where there are several of a kind: destinations before map spots
/// before anything else. Not counted are those outside sectors of `tag` (0: anywhere).
const Actor* draw_thing(World& world, int32_t thing_id, int32_t tag) {
  const auto rank_of = [&](const Actor& actor) {
    const int32_t editor_number = world.type_of(actor).editor_number;
    if (editor_number == kDestinationThing || editor_number == kDestinationWithGravity ||
        editor_number == kDestinationInAir)
      return 0;
    return world.catalog().is_a(actor.type, "MapSpot") ? 1 : 2;
  };
  const auto visit_all = [&](auto visit) {
    for (const Actor* spot = world.find_thing(thing_id); spot != nullptr;
         spot = world.find_thing(thing_id, spot->thing_order))
      if (tag == 0 || world.sectors()[spot->sector_index].tag == tag) visit(*spot);
  };
  int best_rank = 3;
  uint32_t count = 0;
  visit_all([&](const Actor& spot) {
    const int rank = rank_of(spot);
    if (rank < best_rank) best_rank = rank, count = 0;
    count += rank == best_rank;
  });
  if (count == 0) return nullptr;
  uint32_t wanted = count > 1 && best_rank < 2 ? world.rng().below(count) : 0;
  const Actor* chosen = nullptr;
  visit_all([&](const Actor& spot) {
    if (chosen == nullptr && rank_of(spot) == best_rank && wanted-- == 0) chosen = &spot;
  });
  return chosen;
}

std::optional<Destination> find_destination(World& world, int32_t thing_id, int32_t tag) {
  if (thing_id != 0) {
    const Actor* const spot = draw_thing(world, thing_id, tag);
    if (spot == nullptr) return std::nullopt;
    const bool in_air = world.type_of(*spot).editor_number == kDestinationInAir;
    return Destination{spot->x, spot->y, in_air ? spot->z : kOnFloor, spot->angle};
  }
  if (tag == 0) return std::nullopt;
  // Destinations without an id are no actors: the map has them.
  const uint32_t skill = thing_skill_flag(world.options().skill);
  for (uint32_t sector = 0; sector < world.sectors().size(); ++sector) {
    if (world.sectors()[sector].tag != tag) continue;
    for (const MapThing& thing : world.level().things) {
      if (thing.editor_number != kDestinationThing && thing.editor_number != kDestinationWithGravity &&
          thing.editor_number != kDestinationInAir)
        continue;
      if ((thing.flags & skill) == 0 || world.sector_at(thing.x, thing.y) != sector) continue;
      const bool in_air = thing.editor_number == kDestinationInAir;
      return Destination{
          thing.x, thing.y,
          in_air ? clamped_fixed(int64_t{world.sectors()[sector].floor_height} + thing.height) : kOnFloor,
          degrees_to_angle(thing.angle_degrees)};
    }
  }
  return std::nullopt;
}

// ---------------------------------------------------------------- the journey

/// Sends `actor` there. False where somebody is in the way.
bool travel(World& world, Actor& actor, const Destination& to, const Journey& journey) {
  if (actor.removed || actor.has(ActorFlag::kNoTeleport)) return false;
  const Fixed from_x = actor.x, from_y = actor.y, from_z = actor.z;
  const bool missile = actor.has(ActorFlag::kMissile);
  Fixed z = to.z;
  if (journey.keep_height || missile) {
    const Fixed floor = world.sectors()[world.sector_at(to.x, to.y)].floor_height;
    z = clamped_fixed(int64_t{floor} + actor.z - actor.floor_z);
  }
  Angle turned = 0;
  switch (journey.turn) {
    case Turn::kToDestination:
      turned = to.angle - actor.angle;
      break;
    case Turn::kKeep:
      break;
    case Turn::kByLine:
      turned = journey.line_angle - to.angle + kAngle90;
      break;
  }
  if (!teleport_move(world, actor, to.x, to.y, z, actor.angle + turned, false, true, actor.player_index >= 0))
    return false;
  // It is put onto the floor of its centre; one that its box reaches over lifts it when it moves next.
  if (z == kOnFloor || journey.keep_height) {
    const Fixed old_z = actor.z;
    actor.z = z == kOnFloor ? world.sectors()[actor.sector_index].floor_height : z;
    if (Player* const player = world.player_of(actor)) player->view_z += actor.z - old_z;
  }
  if (missile || journey.turn == Turn::kByLine) {
    turn_velocity(actor, turned);
  } else if (!journey.keep_velocity && journey.turn != Turn::kKeep) {
    actor.velocity_x = actor.velocity_y = actor.velocity_z = 0;
    if (Player* const player = world.player_of(actor)) player->walk_x = player->walk_y = 0;
  }
  if (Player* const player = world.player_of(actor);
      player != nullptr && journey.destination_fog && !journey.keep_velocity)
    player->field_of_view = kFieldOfViewAfterTeleport;
  if (journey.source_fog && !missile) spawn_fog(world, from_x, from_y, from_z);
  if (journey.destination_fog)
    spawn_fog(world, clamped_fixed(int64_t{actor.x} + int64_t{kFogAhead} * fine_cosine(actor.angle)),
              clamped_fixed(int64_t{actor.y} + int64_t{kFogAhead} * fine_sine(actor.angle)), actor.z);
  const bool gentle =
      journey.keep_velocity || (!journey.destination_fog && journey.turn != Turn::kToDestination);
  if (actor.player_index >= 0 && !gentle) actor.reaction_tics = kFreezeTics;
  return true;
}

/// Where something at (x, y) would be if `from` were moved and turned into `to`.
Destination carried_over(const Actor& body, const Actor& from, const Actor& to) {
  const Angle turned = to.angle - from.angle;
  const int64_t dx = int64_t{body.x} - from.x, dy = int64_t{body.y} - from.y;
  const Fixed sine = fine_sine(turned), cosine = fine_cosine(turned);
  return {clamped_fixed(to.x + ((dx * cosine - dy * sine) >> kFracBits)),
          clamped_fixed(to.y + ((dx * sine + dy * cosine) >> kFracBits)),
          clamped_fixed(int64_t{body.z} - from.z + to.z), body.angle + turned};
}

/// An actor that crosses a line comes out of another one, as if both were one. `flip`: on its other side.
bool travel_by_line(World& world, Actor& actor, uint32_t from_line, uint32_t to_line, bool flip) {
  const Level& level = world.level();
  const auto ends = [&](uint32_t line) {
    return std::pair(level.vertices[level.linedefs[line].start], level.vertices[level.linedefs[line].end]);
  };
  const auto [from_start, from_end] = ends(from_line);
  const auto [to_start, to_end] = ends(to_line);
  const int64_t from_dx = int64_t{from_end.x} - from_start.x, from_dy = int64_t{from_end.y} - from_start.y;
  const int64_t to_dx = int64_t{to_end.x} - to_start.x, to_dy = int64_t{to_end.y} - to_start.y;
  // How far along the line, 16.16; along its longer axis.
  int64_t along = std::abs(from_dx) > std::abs(from_dy)
                      ? (int64_t{actor.x} - from_start.x) * kFracUnit / from_dx
                      : (int64_t{actor.y} - from_start.y) * kFracUnit / from_dy;
  along = std::clamp<int64_t>(along, 0, kFracUnit);
  if (flip) along = kFracUnit - along;
  int64_t x = to_end.x - ((to_dx * along) >> kFracBits), y = to_end.y - ((to_dy * along) >> kFracBits);
  // A hair beyond the line, on the side where it comes out.
  const BlockLine& line = world.index().blockmap.lines()[to_line];
  const int wanted_side = flip ? -1 : 1;
  for (int i = 0; i < kNudges && line.side_of(x, y) != wanted_side; ++i) {
    if (std::abs(to_dx) > std::abs(to_dy)) {
      y -= (to_dx < 0 ? -1 : 1) * wanted_side;
    } else {
      x += (to_dy < 0 ? -1 : 1) * wanted_side;
    }
  }
  const Angle turned = line_angle(world, static_cast<int32_t>(to_line)) -
                       line_angle(world, static_cast<int32_t>(from_line)) + (flip ? 0u : kAngle180);
  const Fixed to_x = clamped_fixed(x), to_y = clamped_fixed(y);
  const Fixed floor = world.sectors()[world.sector_at(to_x, to_y)].floor_height;
  const Fixed z = clamped_fixed(int64_t{floor} + actor.z - actor.floor_z);
  if (!teleport_move(world, actor, to_x, to_y, z, actor.angle + turned, false, true, actor.player_index >= 0))
    return false;
  turn_velocity(actor, turned);
  return true;
}

}  // namespace

bool teleport_to(World& world, Actor& actor, int32_t thing_id, int32_t sector_tag, bool fog,
                 bool keep_orientation) {
  const std::optional<Destination> to = find_destination(world, thing_id, sector_tag);
  return to && travel(world, actor, *to,
                      {.source_fog = fog,
                       .destination_fog = fog,
                       .keep_velocity = keep_orientation,
                       .turn = keep_orientation ? Turn::kKeep : Turn::kToDestination});
}

std::optional<int32_t> execute_teleport_special(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  const auto send = [&](int32_t thing_id, int32_t tag, const Journey& journey) {
    // An actor that comes from behind leaves the teleporter.
    if (call.activator == nullptr || call.back_side) return 0;
    const std::optional<Destination> to = find_destination(world, thing_id, tag);
    return to && travel(world, *call.activator, *to, journey) ? 1 : 0;
  };
  switch (call.number) {
    case Special::kTeleport_ZombieChanger:  // thing, tag
      return send(a[0], a[1], {.source_fog = false, .destination_fog = false});
    case Special::kTeleport:  // thing, tag, no fog at the start
      return send(a[0], a[1], {.source_fog = a[2] == 0});
    case Special::kTeleport_NoFog: {  // thing, facing, tag, keep height
      Journey journey{.source_fog = false, .destination_fog = false, .keep_height = a[3] != 0};
      // In ViZDoom every other `facing` is the destination's.
      if (a[1] == 0) journey.turn = call.line >= 0 ? Turn::kByLine : Turn::kKeep;
      if (call.line >= 0) journey.line_angle = line_angle(world, call.line);
      return send(a[0], a[2], journey);
    }
    case Special::kTeleport_NoStop:  // thing, tag, no fog at the start
      return send(a[0], a[1], {.source_fog = a[2] == 0, .keep_velocity = true});
    case Special::kTeleportOther: {  // things, thing, fog
      bool any = false;
      world.each_thing(a[0], nullptr, [&](Actor& other) {
        if (const std::optional<Destination> to = find_destination(world, a[1], 0))
          any = travel(world, other, *to, {.source_fog = a[2] != 0, .destination_fog = a[2] != 0}) || any;
      });
      return any;
    }
    case Special::kTeleportGroup:       // things, source, destination, source moves too, fog
    case Special::kTeleportInSector: {  // tag, source, destination, fog, things (0 all)
      const bool in_sector = call.number == Special::kTeleportInSector;
      Actor* const from = world.find_thing(a[1]);
      const Actor* const to = world.find_thing(a[2]);
      if (from == nullptr || to == nullptr) return 0;
      const bool fog = in_sector ? a[3] != 0 : a[4] != 0;
      bool any = false;
      const auto carry = [&](Actor& body) {
        if (body.id == from->id || body.id == to->id) return;
        const Destination place = carried_over(body, *from, *to);
        any =
            travel(world, body, place, {.source_fog = fog, .destination_fog = fog, .keep_velocity = true}) ||
            any;
      };
      if (in_sector) {
        const std::size_t count = world.state().actors.size();
        for (std::size_t slot = 0; slot < count; ++slot) {
          Actor& body = world.state().actors[slot];
          if (body.removed || world.sectors()[body.sector_index].tag != a[0]) continue;
          if (a[4] == 0 ? body.has(ActorFlag::kNoBlockmap) : body.thing_id != a[4]) continue;
          carry(body);
        }
      } else {
        world.each_thing(a[0], call.activator, carry);
        if (a[3] != 0) teleport_move(world, *from, to->x, to->y, to->z, to->angle, false, true, false);
      }
      return any;
    }
    case Special::kTeleport_Line: {  // its own id, id of the other line, flip
      if (call.activator == nullptr || call.line < 0 || call.back_side || a[1] == 0) return 0;
      for (uint32_t line = 0; line < world.lines().size(); ++line) {
        if (static_cast<int32_t>(line) == call.line || world.lines()[line].id != a[1]) continue;
        return travel_by_line(world, *call.activator, static_cast<uint32_t>(call.line), line, a[2] != 0);
      }
      return 0;
    }
    default:
      return std::nullopt;
  }
}

}  // namespace comrad::doom
