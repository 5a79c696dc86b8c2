#include "sim_workers/engine/specials/sector_bodies.h"

#include <algorithm>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/specials/movers.h"

namespace comrad::doom {
namespace {

constexpr Fixed kFallingFloor = to_fixed(9);  // bodies leave a floor that sinks as fast as this
constexpr uint64_t kCrushEveryTics = 4;
constexpr int kPushDepthMax = 16;  // bodies on bodies on bodies

/// Sector heights round a body, and bodies that it stands on or under.
struct Opening {
  Fixed floor_z = 0, ceiling_z = 0, lowest_floor_z = 0;
  uint32_t floor_sector = 0;
  Fixed ground_z = 0, roof_z = 0;  // without bodies
};

bool is_solid_body(const Actor& body) {
  return body.has(ActorFlag::kSolid) && !body.is_corpse() && !body.removed && !body.has(ActorFlag::kNoClip) &&
         !body.has(ActorFlag::kMissile);
}

bool overlap_from_above(const Actor& a, const Actor& b) {
  const int64_t reach = int64_t{a.radius} + b.radius;
  return std::abs(int64_t{a.x} - b.x) < reach && std::abs(int64_t{a.y} - b.y) < reach;
}

/// Calls visit(other) for the solid bodies that overlap `body` seen from above.
template <typename Visit>
void for_each_overlapping(World& world, const Actor& body, Visit visit) {
  WorldState& state = world.state();
  const Blockmap& blockmap = world.index().blockmap;
  const Box reach = Box::around(body.x, body.y, clamped_fixed(int64_t{body.radius} + state.radius_max));
  for (int row = blockmap.row_of(reach.bottom); row <= blockmap.row_of(reach.top); ++row) {
    for (int column = blockmap.column_of(reach.left); column <= blockmap.column_of(reach.right); ++column) {
      int32_t next = state.cell_heads[static_cast<std::size_t>(row) * blockmap.columns() + column];
      while (next >= 0) {
        Actor& other = state.actors[static_cast<std::size_t>(next)];
        next = state.links[static_cast<std::size_t>(next)].next;
        if (other.id == body.id || !is_solid_body(other) || !overlap_from_above(body, other)) continue;
        visit(other);
      }
    }
  }
}

Opening opening_at(World& world, const Actor& body) {
  const auto& sectors = world.state().sectors;
  const Sector& centre = sectors[body.sector_index];
  Opening opening{centre.floor_height, centre.ceiling_height, centre.floor_height, body.sector_index};
  const Box box = Box::around(body.x, body.y, body.radius);
  world.index().blockmap.for_each_line(box, [&](const BlockLine& line) {
    if (line.back_sector < 0 || world.level().linedefs[line.linedef_index].in_polyobject ||
        !line.crosses(box))
      return true;
    for (const int32_t side : {line.front_sector, line.back_sector}) {
      const Sector& sector = sectors[static_cast<std::size_t>(side)];
      opening.ceiling_z = std::min(opening.ceiling_z, sector.ceiling_height);
      opening.lowest_floor_z = std::min(opening.lowest_floor_z, sector.floor_height);
      if (sector.floor_height > opening.floor_z)
        opening.floor_z = sector.floor_height, opening.floor_sector = static_cast<uint32_t>(side);
    }
    return true;
  });
  opening.ground_z = opening.floor_z, opening.roof_z = opening.ceiling_z;
  if (is_solid_body(body)) {
    for_each_overlapping(world, body, [&](const Actor& other) {
      const int64_t top = int64_t{other.z} + other.height;
      if (body.z >= top) {
        opening.floor_z = std::max(opening.floor_z, static_cast<Fixed>(top));
      } else if (int64_t{body.z} + body.height <= other.z) {
        opening.ceiling_z = std::min(opening.ceiling_z, other.z);
      }
    });
  }
  return opening;
}

/// Renews what holds `body`. Returns the floor that it had.
Fixed renew_opening(World& world, Actor& body) {
  const Fixed old_floor_z = body.floor_z;
  const Opening opening = opening_at(world, body);
  body.floor_z = opening.floor_z, body.ceiling_z = opening.ceiling_z;
  body.ground_z = opening.ground_z, body.roof_z = opening.roof_z;
  body.dropoff_z = opening.lowest_floor_z, body.floor_sector_index = opening.floor_sector;
  return old_floor_z;
}

/// A corpse, a dropped item and the like give way. True where the body stays and has no room.
bool resists_crushing(World& world, Actor& body) {
  if (body.is_corpse() && !body.has(ActorFlag::kDontGib) && body.health <= 0) {
    body.set(ActorFlag::kSolid, false);
    body.set(ActorFlag::kDontGib);
    body.height = 0, body.radius = 0;
    if (!set_label(world, body, StateLabel::kCrush) && !body.removed) {
      const uint32_t gibs = world.catalog().known().gibs_state;
      if (gibs != kNoState) set_state(world, body, gibs);
    }
    return false;
  }
  if (body.has(ActorFlag::kDropped) && body.player_index < 0 && !body.is_corpse()) {
    world.remove(body.id);
    return false;
  }
  return body.has(ActorFlag::kSolid) && !body.has(ActorFlag::kNoClip) && body.has(ActorFlag::kShootable);
}

/// The bodies of one sector while one of its planes moves.
class Settler {
 public:
  Settler(World& world, PlaneChange change, Fixed distance, int32_t crush)
      : world_(world), change_(change), distance_(distance), crush_(crush) {}

  bool all_fit() const { return all_fit_; }

  void settle(Actor& body) {
    const Fixed old_z = body.z;
    switch (change_) {
      case PlaneChange::kFloorDown:
        sink(body);
        break;
      case PlaneChange::kFloorUp:
        rise(body);
        break;
      case PlaneChange::kCeilingDown:
        press(body);
        break;
      case PlaneChange::kCeilingUp:
        release(body);
        break;
    }
    carry_eye(body, old_z);
  }

 private:
  void carry_eye(Actor& body, Fixed old_z) {
    if (body.player_index < 0 || body.z == old_z) return;
    Player& player = world_.state().players[static_cast<std::size_t>(body.player_index)];
    if (player.actor_id == body.id)
      player.view_z = static_cast<Fixed>(int64_t{player.view_z} + body.z - old_z);
  }

  void sink(Actor& body) {
    const Fixed old_floor_z = renew_opening(world_, body);
    if (old_floor_z == body.floor_z || body.velocity_z != 0) return;
    // One that was put below the floor under its box comes up. What stands rides down, unless the floor drops
    // away faster than that: then gravity takes over.
    if (body.z >= body.floor_z && body.z != old_floor_z) return;
    if (body.has(ActorFlag::kNoGravity) || body.has(ActorFlag::kMoveWithSector) ||
        (distance_ < kFallingFloor && int64_t{body.z} - body.floor_z <= distance_))
      body.z = body.floor_z;
  }

  void rise(Actor& body) {
    const Fixed old_floor_z = renew_opening(world_, body);
    if (old_floor_z == body.floor_z || body.z > body.floor_z) return;
    const Fixed old_z = body.z;
    body.z = body.floor_z;
    switch (push_up(body, old_z, 0)) {
      case Push::kFree:
        break;
      case Push::kNoRoom:
        crush(body);
        break;
      case Push::kHeldByOthers:
        crush(body);
        body.z = old_z;
        break;
    }
  }

  void press(Actor& body) {
    renew_opening(world_, body);
    if (int64_t{body.z} + body.height <= body.ceiling_z) return;
    const int64_t below_ceiling = int64_t{body.ceiling_z} - body.height;
    if (below_ceiling > body.floor_z) {
      body.z = static_cast<Fixed>(below_ceiling);
      return;
    }
    body.z = body.floor_z;
    if (below_ceiling < body.floor_z) crush(body);
  }

  void release(Actor& body) {
    renew_opening(world_, body);
    // One that was squeezed into the floor comes up again.
    if (body.z < body.floor_z && int64_t{body.z} + body.height >= int64_t{body.ceiling_z} - distance_) {
      const int64_t below_ceiling = int64_t{body.ceiling_z} - body.height;
      body.z = static_cast<Fixed>(std::min<int64_t>(body.floor_z, below_ceiling));
    }
  }

  enum class Push : uint8_t { kFree, kNoRoom, kHeldByOthers };

  /// `body` was lifted from `old_z`: so are the bodies that stood on it.
  Push push_up(Actor& body, Fixed old_z, int depth) {
    if (int64_t{body.z} + body.height > body.ceiling_z && !stands_under_body(body, old_z))
      return Push::kNoRoom;
    if (!is_solid_body(body) || depth >= kPushDepthMax) return Push::kFree;
    Push result = Push::kFree;
    for_each_overlapping(world_, body, [&](Actor& other) {
      if (result != Push::kFree) return;
      const int64_t old_top = int64_t{old_z} + body.height, top = int64_t{body.z} + body.height;
      if (other.z < old_top || other.z >= top) return;
      const Fixed other_old_z = other.z;
      other.z = static_cast<Fixed>(top);
      renew_opening(world_, other);
      if (push_up(other, other_old_z, depth + 1) != Push::kFree) {
        crush(other);
        other.z = other_old_z;
        result = Push::kHeldByOthers;
        return;
      }
      carry_eye(other, other_old_z);
    });
    if (result == Push::kFree) renew_opening(world_, body);
    if (result == Push::kFree && int64_t{body.z} + body.height > body.ceiling_z) return Push::kNoRoom;
    return result;
  }

  /// True where what limits its ceiling is a body that can be lifted, not the sector's ceiling.
  bool stands_under_body(const Actor& body, Fixed old_z) {
    bool found = false;
    const int64_t old_top = int64_t{old_z} + body.height;
    for_each_overlapping(world_, body, [&](const Actor& other) {
      found = found || (other.z >= old_top && other.z < int64_t{body.z} + body.height);
    });
    return found;
  }

  void crush(Actor& body) {
    if (!resists_crushing(world_, body)) return;
    all_fit_ = false;
    if (crush_ <= 0 || world_.tic_count() % kCrushEveryTics != 0) return;
    const int32_t health = body.health;
    damage_actor(world_, body, nullptr, nullptr, crush_, DamageType::kCrush);
    spray_blood(body, health);
  }

  void spray_blood(const Actor& body, int32_t health_before) {
    const uint32_t blood = world_.catalog().known().blood;
    if (body.health >= health_before || body.has(ActorFlag::kNoBlood) || blood == kNoType) return;
    Actor& drop =
        world_.spawn_unchecked(blood, body.x, body.y, static_cast<Fixed>(int64_t{body.z} + body.height / 2));
    drop.velocity_x = world_.random_triangle() * (1 << 12);
    drop.velocity_y = world_.random_triangle() * (1 << 12);
  }

  World& world_;
  PlaneChange change_;
  Fixed distance_;
  int32_t crush_;
  bool all_fit_ = true;
};

}  // namespace

bool touches_sector(const World& world, const Actor& body, uint32_t sector) {
  if (body.sector_index == sector) return true;
  const Box box = Box::around(body.x, body.y, body.radius);
  const auto& lines = world.index().blockmap.lines();
  for (const uint32_t index : world.level().sector_linedefs[sector])
    if (lines[index].box.overlaps(box) && lines[index].crosses(box)) return true;
  return false;
}

bool settle_bodies(World& world, uint32_t sector, PlaneChange change, Fixed distance, int32_t crush) {
  WorldState& state = world.state();
  // A box round the sector spares most bodies the look at its lines.
  Box bounds = Box::nothing();
  for (const uint32_t index : world.level().sector_linedefs[sector])
    bounds.cover(world.index().blockmap.lines()[index].box);
  Settler settler(world, change, distance, crush);
  const std::size_t count = state.actors.size();  // blood that is spilt meanwhile stays out
  for (std::size_t slot = 0; slot < count; ++slot) {
    Actor& body = state.actors[slot];
    if (body.removed || body.has(ActorFlag::kNoSector) || body.has(ActorFlag::kNoBlockmap) ||
        body.has(ActorFlag::kNoInteraction))
      continue;
    if (body.sector_index != sector) {
      if (!Box::around(body.x, body.y, body.radius).overlaps(bounds)) continue;
      if (!touches_sector(world, body, sector)) continue;
    }
    settler.settle(body);
  }
  return settler.all_fit();
}

bool change_sector(World& world, uint32_t sector, int32_t crush) {
  bool fits = true;
  for (const PlaneChange change : {PlaneChange::kFloorUp, PlaneChange::kFloorDown, PlaneChange::kCeilingDown})
    fits = settle_bodies(world, sector, change, 0, crush) && fits;
  return fits;
}

}  // namespace comrad::doom
