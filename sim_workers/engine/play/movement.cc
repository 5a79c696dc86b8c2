#include "sim_workers/engine/play/movement.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/monsters.h"
#include "sim_workers/engine/world/polyobject_lines.h"

namespace comrad::doom {
namespace {

constexpr int kSlideTries = 2;
constexpr std::size_t kItemsPerMove = 32;  // more within one body's reach wait for the next move

/// Bodies that already overlap do not hold each other: a move that takes them apart, by Doom's estimate of distances, is free.
bool moves_apart(const Actor& body, const Actor& other, Fixed x, Fixed y) {
  const int64_t reach = int64_t{body.radius} + other.radius;
  const int64_t dx = int64_t{body.x} - other.x, dy = int64_t{body.y} - other.y;
  if (std::abs(dx) >= reach || std::abs(dy) >= reach) return false;
  return approximate_distance(int64_t{x} - other.x, int64_t{y} - other.y) > approximate_distance(dx, dy);
}

bool is_polyobject_line(const WorldState& state, uint32_t line) {
  for (const Polyobject& polyobject : state.movers.polyobjects)
    if (std::find(polyobject.lines.begin(), polyobject.lines.end(), line) != polyobject.lines.end())
      return true;
  return false;
}

/// ZDoom's, Hexen's and, with both flags, Strife's damage of a fall, as ViZDoom plays them.
void hurt_by_landing(World& world, Actor& body) {
  const bool old = world.has(wad::GameFlag::kOldFallDamage), hexen = world.has(wad::GameFlag::kFallDamage);
  if (!old && !hexen) return;
  constexpr Fixed kOldFrom = to_fixed(19), kStrifeFrom = to_fixed(20), kHexenFrom = to_fixed(23);
  constexpr Fixed kHexenMayKillFrom = to_fixed(39), kHexenKillsFrom = to_fixed(63);
  const Fixed speed = -body.velocity_z;
  int32_t amount = 0;
  if (old && hexen) {
    if (speed > kStrifeFrom) amount = speed / 25'000;
  } else if (old) {
    if (speed > kOldFrom)
      amount = (fixed_mul(speed, fixed_mul(speed, to_fixed(11) / 128)) - to_fixed(30)) >> (kFracBits + 1);
  } else if (speed >= kHexenKillsFrom) {
    amount = kTelefragDamage;
  } else if (speed > kHexenFrom) {
    const Fixed scaled = fixed_mul(speed, to_fixed(16) / 23);
    amount = ((fixed_mul(scaled, scaled) / 10) >> kFracBits) - 24;
    if (speed < kHexenMayKillFrom && amount > body.health && body.health != 1) amount = body.health - 1;
  }
  if (amount > 0) damage_actor(world, body, nullptr, nullptr, amount);
}

/// A player that steers much in the air is slowed there too. Measured in ViZDoom 1.3.2 with SetAirControl of 0.01 to 2.0: what is
/// left of its velocity after a tic is 1.0004 - 0.0941 x air control.
void slow_in_air(Player& player, Actor& body, Fixed air_control) {
  if (air_control <= kAirControl) return;
  const Fixed left = std::clamp(0x1001A + fixed_mul(-0x1817, air_control), 0, kFracUnit);
  for (Fixed* const velocity : {&body.velocity_x, &body.velocity_y, &player.walk_x, &player.walk_y})
    *velocity = fixed_mul(*velocity, left);
}

/// A wall that takes a player's speed takes its steps' part too.
void limit_walk(World& world, const Actor& body) {
  Player* const walker = world.player_of(body);
  if (walker == nullptr) return;
  if (std::abs(walker->walk_x) > std::abs(body.velocity_x)) walker->walk_x = body.velocity_x;
  if (std::abs(walker->walk_y) > std::abs(body.velocity_y)) walker->walk_y = body.velocity_y;
}

/// A line of a polyobject where it is now, as the blockmap packs lines.
BlockLine moved_line(const World& world, uint32_t line, Fixed x1, Fixed y1, Fixed x2, Fixed y2) {
  BlockLine moved = world.index().blockmap.lines()[line];
  moved.x1 = x1, moved.y1 = y1, moved.x2 = x2, moved.y2 = y2;
  moved.box = Box::around_ends(x1, y1, x2, y2);
  return moved;
}

/// Calls visit(line, flags) for the lines that may touch the box, polyobjects at their present
/// place included.
template <typename Visit>
void for_each_line_near(const World& world, const Box& box, Visit&& visit) {
  const WorldState& state = world.state();
  const bool has_polyobjects = !state.movers.polyobjects.empty();
  bool stopped = false;
  world.index().blockmap.for_each_line(box, [&](const BlockLine& line) {
    if (has_polyobjects && is_polyobject_line(state, line.linedef_index)) return true;
    stopped = !visit(line, state.lines[line.linedef_index].flags);
    return !stopped;
  });
  if (!has_polyobjects || stopped) return;
  for_each_polyobject_line(world, box.left, box.right, box.bottom, box.top,
                           [&](uint32_t index, Fixed x1, Fixed y1, Fixed x2, Fixed y2) {
                             const BlockLine line = moved_line(world, index, x1, y1, x2, y2);
                             return !line.box.overlaps(box) || visit(line, state.lines[index].flags);
                           });
}

}  // namespace

int64_t meeting_fraction(const Way& way, const Way& other) {
  __int128 numerator = static_cast<__int128>(other.dy) * (way.x - other.x) -
                       static_cast<__int128>(other.dx) * (way.y - other.y);
  __int128 denominator = static_cast<__int128>(other.dx) * way.dy - static_cast<__int128>(other.dy) * way.dx;
  if (denominator == 0) return 0;
  if (denominator < 0) numerator = -numerator, denominator = -denominator;
  numerator *= kFracUnit;
  __int128 fraction = numerator / denominator, rest = numerator % denominator;
  if (rest < 0) --fraction, rest += denominator;
  if (2 * rest > denominator || (2 * rest == denominator && (fraction & 1) != 0)) ++fraction;
  constexpr int64_t kFarthest = int64_t{1} << 61;  // so that two of them have a difference
  return static_cast<int64_t>(std::clamp<__int128>(fraction, -kFarthest, kFarthest));
}

void turn_along(const Way& wall, Way& move) {
  if (wall.dy == 0) {
    move.dy = 0;
  } else if (wall.dx == 0) {
    move.dx = 0;
  } else {
    const Way across{move.x, move.y, wall.dy, -wall.dx};
    const int64_t way_along = meeting_fraction(wall, move) - meeting_fraction(wall, across);
    const int64_t moves = meeting_fraction(move, wall);
    // Where the body's centre all but lies on the wall these fractions say nothing; it is not thrown along it.
    const int64_t longest = moves == 0 ? 0 : 2 * (std::abs(move.dx) + std::abs(move.dy));
    const auto part = [&](int64_t wall_part) {
      const __int128 turned = static_cast<__int128>(way_along) * wall_part / (moves == 0 ? 1 : moves);
      return static_cast<int64_t>(std::clamp<__int128>(turned, -longest, longest));
    };
    move.dx = part(wall.dx), move.dy = part(wall.dy);
  }
}

bool Movement::line_stops(const BlockLine& line, uint32_t flags, const Actor& body) const {
  if (line.back_sector < 0 || (flags & kLineBlockEverything) != 0) return true;
  const bool missile = body.has(ActorFlag::kMissile);
  if ((flags & kLineBlocking) != 0 && !missile) return true;
  if ((flags & kLineBlockProjectiles) != 0 && missile) return true;
  if ((flags & kLineBlockPlayers) != 0 && body.player_index >= 0) return true;
  if ((flags & kLineBlockFloaters) != 0 && body.has(ActorFlag::kFloat)) return true;
  return (flags & kLineBlockMonsters) != 0 && body.player_index < 0 && body.has(ActorFlag::kIsMonster) &&
         !body.has(ActorFlag::kNoBlockMonsters);
}

bool Movement::missile_passes(Actor& missile, Actor& other) {
  if (!other.has(ActorFlag::kShootable)) return !other.has(ActorFlag::kSolid);
  if (other.id == missile.target_id) return true;  // the shooter
  if (other.has(ActorFlag::kGhost) && missile.has(ActorFlag::kThruGhost)) return true;
  Actor* source = world_.actor(missile.target_id);
  // Kin do not hurt each other with missiles, unless a quarrel is the rule; players are never kin.
  if (source != nullptr && source->player_index < 0 && other.player_index < 0) {
    const auto species = [&](const Actor& actor) {
      const ActorType& type = world_.type_of(actor);
      return type.species != kNoType ? type.species : actor.type;
    };
    if (species(*source) == species(other) && !other.has(ActorFlag::kNoInfighting))
      return false;  // it ends there
  }
  if (missile.has(ActorFlag::kRipper)) {
    if (other.id == last_ripped_) return true;
    last_ripped_ = other.id;
  }
  const int32_t damage = roll_damage(world_, missile.damage);
  if (missile.has(ActorFlag::kRipper)) {
    if (damage > 0) {
      damage_actor(world_, other, &missile, source, damage, missile.damage_type);
    } else if (Player* const shooter = source != nullptr ? world_.player_of(*source) : nullptr) {
      ++shooter->hits_dealt;  // without damage it counts as a hit all the same
    }
    return true;
  }
  if (damage > 0) damage_actor(world_, other, &missile, source, damage, missile.damage_type);
  return false;
}

bool Movement::check_things(std::size_t slot, Fixed x, Fixed y, bool touch, PositionCheck& check) {
  Actor& body = state_.actors[slot];
  if (body.has(ActorFlag::kNoInteraction)) return true;
  const bool missile = body.has(ActorFlag::kMissile);
  const bool body_solid = (body.has(ActorFlag::kSolid) || missile) && !body.is_corpse();
  const bool takes_items = touch && body.has(ActorFlag::kPickup) && !body.is_corpse();
  const bool charges = touch && body.has(ActorFlag::kSkullFly);
  if (!body_solid && !takes_items) return true;

  const Fixed radius = body.radius;
  const Blockmap& blockmap = world_.index().blockmap;
  const Box reach = Box::around(x, y, clamped_fixed(int64_t{radius} + state_.radius_max));
  // Items are taken after the scan, because taking one runs a script that may change the lists.
  std::array<std::size_t, kItemsPerMove> items;
  std::size_t item_count = 0;
  bool fits = true;
  const int first_column = blockmap.column_of(reach.left), last_column = blockmap.column_of(reach.right);
  const int first_row = blockmap.row_of(reach.bottom), last_row = blockmap.row_of(reach.top);
  Actor* struck = nullptr;
  for (int row = first_row; row <= last_row && fits; ++row) {
    for (int column = first_column; column <= last_column && fits; ++column) {
      int32_t next = state_.cell_heads[static_cast<std::size_t>(row) * blockmap.columns() + column];
      while (next >= 0) {
        const auto other_slot = static_cast<std::size_t>(next);
        next = state_.links[other_slot].next;
        if (other_slot == slot) continue;
        Actor& other = state_.actors[other_slot];
        const int64_t distance = int64_t{other.radius} + radius;
        if (std::abs(int64_t{other.x} - x) >= distance || std::abs(int64_t{other.y} - y) >= distance)
          continue;
        if (other.has(ActorFlag::kSpecial)) {
          if (takes_items && item_count < items.size()) items[item_count++] = other_slot;
          continue;
        }
        if (missile) {
          const int64_t pass = world_.type_of(other).projectile_pass_height;
          const int64_t top = pass > 0   ? pass
                              : pass < 0 ? int64_t{other.height} + pass
                                         : int64_t{other.height};
          if (body.z > int64_t{other.z} + top || int64_t{body.z} + body.height < other.z) continue;
          if (!other.has(ActorFlag::kShootable) && !other.has(ActorFlag::kSolid)) continue;
          if (other.id == body.target_id) continue;
          if (touch) {
            struck = &other, fits = false;
            check.fits = false, check.blocked_by_actor = true, check.blocking_actor_id = other.id;
            break;
          }
          check.fits = fits = false;
          check.blocked_by_actor = true, check.blocking_actor_id = other.id;
          break;
        }
        if (!body_solid || !other.has(ActorFlag::kSolid)) continue;
        // A player steps up onto what is no higher than a stair.
        const bool steps_up = touch && body.player_index >= 0 &&
                              int64_t{other.top()} - body.z <= world_.type_of(body).max_step_height;
        // A solid dead monster stops a body that cannot step onto it, and carries none.
        const bool holds = !other.is_corpse() || !other.has(ActorFlag::kIsMonster);
        if (body.z >= other.top()) {
          if (holds) check.floor_z = std::max(check.floor_z, other.top());
        } else if (body.top() <= other.z) {
          check.ceiling_z = std::min(check.ceiling_z, other.z);
        } else if (!charges && moves_apart(body, other, x, y)) {
          continue;  // nor is it a step
        } else if (steps_up) {
          check.steps_onto_actor = true;
          if (holds) check.floor_z = std::max(check.floor_z, other.top());
        } else {
          check.blocked_by_actor = true;
          check.blocking_actor_id = other.id;
          check.fits = fits = false;
          if (charges) struck = &other;
          break;
        }
      }
    }
  }
  if (struck != nullptr && missile) {
    if (missile_passes(body, *struck)) {
      // A ripper goes through: what else is there waits for its next step.
      check.fits = fits = true, check.blocked_by_actor = false, check.blocking_actor_id = 0;
    }
  } else if (struck != nullptr && charges) {
    skull_struck(world_, body, struck);
  }
  // In ViZDoom's order: by the first cell, row by row, that both boxes reach into, then the newest first.
  const auto first_cell = [&](std::size_t item) {
    const Actor& actor = state_.actors[item];
    const int row = blockmap.row_of(std::max<int64_t>(int64_t{actor.y} - actor.radius, int64_t{y} - radius));
    return row * blockmap.columns() +
           blockmap.column_of(std::max<int64_t>(int64_t{actor.x} - actor.radius, int64_t{x} - radius));
  };
  const auto comes_before = [&](std::size_t item, std::size_t other) {
    const int cell = first_cell(item), other_cell = first_cell(other);
    if (cell != other_cell) return cell < other_cell;
    return state_.links[item].cell != state_.links[other].cell &&
           state_.actors[item].id > state_.actors[other].id;
  };
  for (std::size_t i = 1; i < item_count; ++i)
    for (std::size_t j = i; j > 0 && comes_before(items[j], items[j - 1]); --j)
      std::swap(items[j], items[j - 1]);
  for (std::size_t i = 0; i < item_count; ++i) {
    if (state_.actors[items[i]].removed) continue;
    touch_item(world_, state_.actors[slot], state_.actors[items[i]]);
  }
  return fits;
}

bool Movement::check_line(const BlockLine& line, const Actor& body, PositionCheck& check) {
  const uint32_t flags = state_.lines[line.linedef_index].flags;
  if (line_stops(line, flags, body)) {
    check.fits = false;
    check.blocking_line = static_cast<int32_t>(line.linedef_index);
    return false;
  }
  const Sector& front = state_.sectors[static_cast<std::size_t>(line.front_sector)];
  const Sector& back = state_.sectors[static_cast<std::size_t>(line.back_sector)];
  const Fixed ceiling = std::min(front.ceiling_height, back.ceiling_height);
  if (ceiling < check.ceiling_z) {
    check.ceiling_z = ceiling;
    check.ceiling_line = static_cast<int32_t>(line.linedef_index);
  }
  const Fixed floor = std::max(front.floor_height, back.floor_height);
  check.ground_z = std::max(check.ground_z, floor), check.roof_z = std::min(check.roof_z, ceiling);
  if (floor > check.floor_z) {
    check.floor_z = floor;
    check.floor_sector_index =
        static_cast<uint32_t>(front.floor_height >= back.floor_height ? line.front_sector : line.back_sector);
    check.blocking_line = static_cast<int32_t>(line.linedef_index);
  }
  check.lowest_floor_z = std::min({check.lowest_floor_z, front.floor_height, back.floor_height});
  if (state_.lines[line.linedef_index].special != 0 && check.touched_count < check.touched_lines.size()) {
    const auto end = check.touched_lines.begin() + static_cast<std::ptrdiff_t>(check.touched_count);
    if (std::find(check.touched_lines.begin(), end, line.linedef_index) == end)
      check.touched_lines[check.touched_count++] = line.linedef_index;
  }
  return true;
}

bool Movement::check_lines(std::size_t slot, Fixed x, Fixed y, PositionCheck& check) {
  const Actor& body = state_.actors[slot];
  const Box box = Box::around(x, y, body.radius);
  for_each_line_near(world_, box, [&](const BlockLine& line, uint32_t) {
    return !line.crosses(box) || check_line(line, body, check);
  });
  return check.fits;
}

PositionCheck Movement::check_position(std::size_t slot, Fixed x, Fixed y, bool touch) {
  PositionCheck check = opening_of_point(world_, x, y);
  if (state_.actors[slot].has(ActorFlag::kNoClip)) return check;
  // Things first, as in Doom: an item is taken even where a wall then refuses the move.
  if (check_things(slot, x, y, touch, check)) check_lines(slot, x, y, check);
  return check;
}

PositionCheck Movement::check_walls(std::size_t slot, Fixed x, Fixed y) {
  PositionCheck check = opening_of_point(world_, x, y);
  if (!state_.actors[slot].has(ActorFlag::kNoClip)) check_lines(slot, x, y, check);
  return check;
}

void Movement::look_for_bodies(std::size_t slot) {
  Actor& body = state_.actors[slot];
  PositionCheck check;
  check.floor_z = body.ground_z, check.ceiling_z = body.roof_z;
  if (check_things(slot, body.x, body.y, false, check))
    body.floor_z = check.floor_z, body.ceiling_z = check.ceiling_z;
}

void Movement::place(std::size_t slot, Fixed x, Fixed y, const PositionCheck& check) {
  Actor& body = state_.actors[slot];
  world_.unlink(body);
  body.x = x, body.y = y;
  body.floor_z = check.floor_z, body.ceiling_z = check.ceiling_z, body.dropoff_z = check.lowest_floor_z;
  body.ground_z = check.ground_z, body.roof_z = check.roof_z;
  body.sector_index = check.sector_index, body.floor_sector_index = check.floor_sector_index;
  world_.link(body);
}

bool Movement::could_step_to(std::size_t slot, Fixed x, Fixed y) {
  const PositionCheck check = check_position(slot, x, y, true);
  const Actor& body = state_.actors[slot];
  return check.fits && int64_t{check.ceiling_z} - std::max(check.floor_z, body.z) >= body.height &&
         int64_t{check.floor_z} - body.z <= world_.type_of(body).max_step_height;
}

bool Movement::try_move(std::size_t slot, Fixed x, Fixed y) { return try_move_with_result(slot, x, y).moved; }

MoveResult Movement::try_move_with_result(std::size_t slot, Fixed x, Fixed y) {
  const MoveResult result = attempt_move(slot, x, y);
  Actor& body = state_.actors[slot];
  if (result.moved || body.removed || body.player_index < 0 || body.is_corpse()) return result;
  // Running into a line may be what it waits for; so may all that the box would have lain on.
  const std::array<uint32_t, kTouchedLinesMax> touched = last_.touched_lines;
  std::size_t count = last_.touched_count;
  const auto push = [&](uint32_t line) {
    const LineState& state = state_.lines[line];
    if (state.special != 0 && (state.flags & kLinePlayerPush) != 0)
      world_.events().activate_line(world_, line, body,
                                    world_.index().blockmap.lines()[line].side_of(body.x, body.y) <= 0,
                                    Activation::kPush);
  };
  const int32_t blocking = result.blocking_line;
  while (count > 0)
    if (const uint32_t line = touched[--count]; static_cast<int32_t>(line) != blocking) push(line);
  if (blocking >= 0) push(static_cast<uint32_t>(blocking));
  return result;
}

MoveResult Movement::attempt_move(std::size_t slot, Fixed x, Fixed y) {
  MoveResult result;
  last_ = check_position(slot, x, y, true);
  result.floor_z = last_.floor_z;
  result.blocking_line = last_.blocking_line;
  result.blocking_actor_id = last_.blocking_actor_id;
  Actor& body = state_.actors[slot];
  if (body.removed || !last_.fits) return result;
  if (!body.has(ActorFlag::kNoClip)) {
    if (int64_t{last_.ceiling_z} - last_.floor_z < body.height) {
      if (result.blocking_line < 0) result.blocking_line = last_.ceiling_line;  // a shut door
      return result;
    }
    result.float_ok = true;
    const bool hugs_floor = body.has(ActorFlag::kFloorHugger);  // it climbs any step
    if (!hugs_floor && int64_t{last_.ceiling_z} - body.z < body.height) {
      if (result.blocking_line < 0) result.blocking_line = last_.ceiling_line;
      return result;
    }
    const Fixed step = body.has(ActorFlag::kMissile) && !body.has(ActorFlag::kStepMissile)
                           ? 0
                           : world_.type_of(body).max_step_height;
    if (!hugs_floor && int64_t{last_.floor_z} - body.z > step) return result;
    // Monsters do not step where the ground below any part of them lies far under what holds them. Who stands
    // on something above its floor counts from there.
    if (body.has(ActorFlag::kIsMonster) && !body.is_corpse() && body.player_index < 0 &&
        !body.has(ActorFlag::kDropOff) && !body.has(ActorFlag::kFloat) && !body.has(ActorFlag::kMissile)) {
      const int64_t held_at = body.z == body.floor_z ? std::max(last_.floor_z, body.z) : last_.floor_z;
      if (held_at - last_.lowest_floor_z > world_.type_of(body).max_dropoff_height) return result;
    }
  }
  const Fixed old_x = body.x, old_y = body.y;
  const PositionCheck check = last_;
  place(slot, x, y, check);
  if (body.has(ActorFlag::kFloorHugger)) body.z = body.floor_z;
  result.moved = true;
  if (check.touched_count > 0 && !body.has(ActorFlag::kNoClip)) cross_lines(slot, old_x, old_y, check);
  return result;
}

void Movement::cross_lines(std::size_t slot, Fixed old_x, Fixed old_y, const PositionCheck& check) {
  Actor& body = state_.actors[slot];
  if (body.is_corpse() || body.has(ActorFlag::kNoInteraction)) return;
  const Activation how = body.player_index >= 0          ? Activation::kCross
                         : body.has(ActorFlag::kMissile) ? Activation::kMissileCross
                                                         : Activation::kMonsterCross;
  const Fixed x = body.x, y = body.y;
  for (std::size_t i = check.touched_count; i-- > 0;) {  // the last touched acts first, as in Doom
    const BlockLine& line = world_.index().blockmap.lines()[check.touched_lines[i]];
    const bool was_behind = line.is_behind(old_x, old_y);
    if (was_behind == line.is_behind(x, y)) continue;
    world_.events().activate_line(world_, line.linedef_index, body, was_behind, how);
    if (body.removed || body.x != x || body.y != y) return;  // teleported
  }
}

void Movement::trace_corner(int64_t x, int64_t y, Fixed dx, Fixed dy, const Actor& body, WallHit& hit) const {
  // A quirk of Doom's: no trace begins on the edge of a blockmap cell; it begins a unit further east or north.
  // Who touches the western or southern wall of a map to the bit thus slides along it with its whole speed.
  if (world_.index().blockmap.on_column_edge(x)) x += kFracUnit, dx -= kFracUnit;
  if (world_.index().blockmap.on_row_edge(y)) y += kFracUnit, dy -= kFracUnit;
  const Box box = {clamped_fixed(std::min(x, x + dx) - 1), clamped_fixed(std::max(x, x + dx) + 1),
                   clamped_fixed(std::min(y, y + dy) - 1), clamped_fixed(std::max(y, y + dy) + 1)};
  // A quirk of Doom's: a short way meets every line of its cells as if the line had no ends.
  constexpr Fixed kShortWay = to_fixed(16);
  const bool endless = std::abs(int64_t{dx}) <= kShortWay && std::abs(int64_t{dy}) <= kShortWay;
  const auto meet = [&](const BlockLine& line, uint32_t flags) {
    if (line.is_behind(x, y) == line.is_behind(x + dx, y + dy)) return true;
    if (!endless) {
      const __int128 first =
          static_cast<__int128>(dy) * (line.x1 - x) - static_cast<__int128>(dx) * (line.y1 - y);
      const __int128 second =
          static_cast<__int128>(dy) * (line.x2 - x) - static_cast<__int128>(dx) * (line.y2 - y);
      if ((first > 0 && second > 0) || (first < 0 && second < 0)) return true;
    }
    if (line.back_sector < 0) {
      if (line.is_behind(body.x, body.y)) return true;  // from behind there is nothing
    } else if (!line_stops(line, flags, body)) {
      const Sector& front = state_.sectors[static_cast<std::size_t>(line.front_sector)];
      const Sector& back = state_.sectors[static_cast<std::size_t>(line.back_sector)];
      const int64_t ceiling_z = std::min(front.ceiling_height, back.ceiling_height);
      const int64_t floor_z = std::max(front.floor_height, back.floor_height);
      if (ceiling_z - floor_z >= body.height && ceiling_z - body.z >= body.height &&
          floor_z - body.z <= kStepUpMax)
        return true;
    }
    const Way wall{line.x1, line.y1, line.dx(), line.dy()};
    if (wall.dx * dy == wall.dy * dx) return true;
    const int64_t fraction = meeting_fraction({x, y, dx, dy}, wall);
    if (fraction >= 0 && fraction <= kFracUnit && fraction < hit.fraction)
      hit = {static_cast<Fixed>(fraction), true, wall};
    return true;
  };
  if (!endless || !state_.movers.polyobjects.empty()) {
    for_each_line_near(world_, box, meet);
    return;
  }
  world_.index().blockmap.for_each_line_in_cells(
      box, [&](const BlockLine& line) { return meet(line, state_.lines[line.linedef_index].flags); });
}

void Movement::slide_along_walls(std::size_t slot, Fixed dx, Fixed dy, int steps) {
  for (int attempt = 0; attempt < kSlideTries; ++attempt) {
    // The three corners that lead the way.
    const Actor& body = state_.actors[slot];
    const int64_t lead_x = int64_t{body.x} + (dx > 0 ? body.radius : -body.radius);
    const int64_t lead_y = int64_t{body.y} + (dy > 0 ? body.radius : -body.radius);
    const int64_t trail_x = int64_t{body.x} - (dx > 0 ? body.radius : -body.radius);
    const int64_t trail_y = int64_t{body.y} - (dy > 0 ? body.radius : -body.radius);
    WallHit hit;
    trace_corner(lead_x, lead_y, dx, dy, body, hit);
    trace_corner(trail_x, lead_y, dx, dy, body, hit);
    trace_corner(lead_x, trail_y, dx, dy, body, hit);
    if (!hit.found) break;

    // Up to the wall, less a gap; the rest of the way along it.
    const Fixed free_fraction = hit.fraction - kSlideGap;
    if (free_fraction > 0) {
      const Fixed speed_x = body.velocity_x, speed_y = body.velocity_y;
      if (!try_move(slot, clamped_fixed(int64_t{body.x} + fixed_mul(dx, free_fraction)),
                    clamped_fixed(int64_t{body.y} + fixed_mul(dy, free_fraction))))
        break;
      const Actor& moved = state_.actors[slot];
      if (moved.velocity_x != speed_x || moved.velocity_y != speed_y)
        return;  // a line that it crossed pushed it
    }
    const Fixed rest_fraction = std::min<Fixed>(kFracUnit - hit.fraction, kFracUnit);
    if (rest_fraction <= 0) return;
    // A quirk of corners: the next attempt starts from the rest of the way as it was, not as it was turned.
    dx = fixed_mul(dx, rest_fraction), dy = fixed_mul(dy, rest_fraction);
    Actor& moved = state_.actors[slot];
    Way along{moved.x, moved.y, dx, dy};
    turn_along(hit.wall, along);
    const auto along_x = static_cast<Fixed>(along.dx), along_y = static_cast<Fixed>(along.dy);
    moved.velocity_x = clamped_fixed(int64_t{along_x} * steps);
    moved.velocity_y = clamped_fixed(int64_t{along_y} * steps);
    limit_walk(world_, moved);
    if (try_move(slot, clamped_fixed(int64_t{moved.x} + along_x), clamped_fixed(int64_t{moved.y} + along_y)))
      return;
  }
  // Wedged in, or stopped by something between the corners: one axis at a time.
  if (!try_move(slot, state_.actors[slot].x, clamped_fixed(int64_t{state_.actors[slot].y} + dy)))
    try_move(slot, clamped_fixed(int64_t{state_.actors[slot].x} + dx), state_.actors[slot].y);
}

void Movement::slide_along_body(std::size_t slot, Fixed x, Fixed y) {
  const bool goes_y = try_move(slot, state_.actors[slot].x, y);
  const bool goes_x = !goes_y && try_move(slot, x, state_.actors[slot].y);
  Actor& body = state_.actors[slot];
  Player* const walker = world_.player_of(body);
  if (!goes_x) {
    body.velocity_x = 0;
    if (walker != nullptr) walker->walk_x = 0;
  }
  if (!goes_y) {
    body.velocity_y = 0;
    if (walker != nullptr) walker->walk_y = 0;
  }
}

void Movement::stop_missile(std::size_t slot) {
  Actor& body = state_.actors[slot];
  // A missile that meets the sky is gone without a bang.
  if (!last_.blocked_by_actor && last_.ceiling_line >= 0 && !body.has(ActorFlag::kSkyExplode)) {
    const BlockLine& line = world_.index().blockmap.lines()[static_cast<std::size_t>(last_.ceiling_line)];
    const Sector& back = state_.sectors[static_cast<std::size_t>(std::max(line.back_sector, 0))];
    if (line.back_sector >= 0 && back.ceiling_texture == "F_SKY1" && body.top() > back.ceiling_height) {
      world_.remove(body.id);
      return;
    }
  }
  if (const int32_t struck = last_.blocking_line >= 0 ? last_.blocking_line : last_.ceiling_line;
      !last_.blocked_by_actor && struck >= 0) {
    const BlockLine& line = world_.index().blockmap.lines()[static_cast<std::size_t>(struck)];
    if (state_.lines[line.linedef_index].special != 0) {
      Actor* const shooter = world_.actor(body.target_id);  // for whom the line acts
      world_.events().activate_line(world_, line.linedef_index, shooter != nullptr ? *shooter : body,
                                    line.side_of(body.x, body.y) <= 0, Activation::kImpact);
    }
    if (body.removed) return;
  }
  explode_missile(world_, body, world_.actor(last_.blocking_actor_id));
}

void Movement::move_horizontally(std::size_t slot, bool pushing, bool stood_on_body) {
  {
    const Actor& body = state_.actors[slot];
    if (body.velocity_x == 0 && body.velocity_y == 0) {
      if (body.has(ActorFlag::kSkullFly)) skull_struck(world_, state_.actors[slot], nullptr);
      return;
    }
    Fixed move_x = body.velocity_x, move_y = body.velocity_y;
    const bool slides = body.player_index >= 0 || body.has(ActorFlag::kSlidesOnWalls);
    // No step longer than the body is wide, less one unit: nothing thick enough to stop it is jumped over.
    const int64_t step_max = std::max<Fixed>(body.radius - kFracUnit, to_fixed(1));
    const int64_t fastest = std::max(std::abs(int64_t{move_x}), std::abs(int64_t{move_y}));
    const auto steps = static_cast<int>(1 + fastest / step_max);
    Fixed start_x = body.x, start_y = body.y;
    for (int step = 1; step <= steps; ++step) {
      const Fixed speed_x = body.velocity_x, speed_y = body.velocity_y;
      const auto x = static_cast<Fixed>(start_x + int64_t{move_x} * step / steps);
      const auto y = static_cast<Fixed>(start_y + int64_t{move_y} * step / steps);
      if (try_move(slot, x, y)) {
        if (body.removed) return;
        if (body.x != x || body.y != y) break;  // a line it crossed sent it elsewhere
        continue;                               // a line that pushed it counts from the next tic on
      }
      if (body.removed) return;
      if (slides && (body.velocity_x != speed_x || body.velocity_y != speed_y))
        break;  // a line that it ran into
      if (slides) {
        // A quirk of ViZDoom's: a wall behind a body that is a step counts as the body.
        if (last_.blocked_by_actor || last_.steps_onto_actor) {
          slide_along_body(slot, x, y);
        } else {
          // Not the way to (x, y): that is longer by what the steps before lost to rounding.
          slide_along_walls(slot, move_x / steps, move_y / steps, steps);
        }
        if (body.removed) return;
      } else if (body.has(ActorFlag::kMissile)) {
        stop_missile(slot);
        return;
      } else {
        if (body.has(ActorFlag::kSkullFly) && !last_.blocked_by_actor)
          skull_struck(world_, state_.actors[slot], nullptr);
        state_.actors[slot].velocity_x = state_.actors[slot].velocity_y = 0;
        return;
      }
      // The steps that are left continue from here with what is left of the velocity.
      const Actor& slid = state_.actors[slot];
      move_x = slid.velocity_x, move_y = slid.velocity_y;
      start_x = static_cast<Fixed>(slid.x - int64_t{move_x} * step / steps);
      start_y = static_cast<Fixed>(slid.y - int64_t{move_y} * step / steps);
      if (move_x == 0 && move_y == 0) break;
    }
  }

  Actor& body = state_.actors[slot];
  if (body.has(ActorFlag::kMissile) || body.has(ActorFlag::kSkullFly)) return;  // these keep their speed
  // The dead slide off a step that they hang over.
  constexpr Fixed kSlideOffSpeed = kFracUnit / 4;
  if (body.is_corpse() &&
      (std::abs(body.velocity_x) > kSlideOffSpeed || std::abs(body.velocity_y) > kSlideOffSpeed) &&
      body.floor_z != state_.sectors[body.sector_index].floor_height)
    return;
  Player* const player = world_.player_of(body);
  if (body.z > body.ground_z && !stood_on_body) {  // a body on the way up is no ground
    if (player != nullptr) slow_in_air(*player, body, state_.air_control);
    return;
  }
  if (!pushing && std::abs(body.velocity_x) < kStopSpeed && std::abs(body.velocity_y) < kStopSpeed) {
    body.velocity_x = body.velocity_y = 0;
    if (player != nullptr) player->walk_x = player->walk_y = 0;
  } else {
    const Fixed friction = footing_of(world_, body).friction;
    body.velocity_x = fixed_mul(body.velocity_x, friction);
    body.velocity_y = fixed_mul(body.velocity_y, friction);
    if (player != nullptr) {
      player->walk_x = fixed_mul(player->walk_x, kGroundFriction);
      player->walk_y = fixed_mul(player->walk_y, kGroundFriction);
    }
  }
}

void Movement::move_vertically(std::size_t slot, bool left_ledge) {
  Actor& body = state_.actors[slot];
  if (body.has(ActorFlag::kFloorHugger)) {  // up only until it moves on
    body.z = clamped_fixed(int64_t{body.floor_z} + std::max(body.velocity_z, 0));
    return;
  }
  Player* player = body.player_index >= 0 && !body.is_corpse()
                       ? &state_.players[static_cast<std::size_t>(body.player_index)]
                       : nullptr;
  const bool over_body = body.floor_z > body.ground_z;
  // Stepped up: the eye stays where it was and catches up. Rising to the top of a body in this tic is no step.
  if (player != nullptr && body.z < body.floor_z &&
      !(over_body && int64_t{body.z} + body.velocity_z >= body.floor_z)) {
    player->view_height = clamped_fixed(int64_t{player->view_height} - body.floor_z + body.z);
    const Fixed normal = fixed_mul(player->eye_height, player->crouch_factor);
    player->view_height_delta = static_cast<Fixed>((int64_t{normal} - player->view_height) >> 3);
  }
  body.z = clamped_fixed(int64_t{body.z} + body.velocity_z);
  // A flyer drifts to the height of its target.
  if (body.has(ActorFlag::kFloat) && body.target_id != 0 && !body.has(ActorFlag::kSkullFly) &&
      !body.has(ActorFlag::kInFloat) && !body.is_corpse()) {
    if (const Actor* target = world_.actor(body.target_id)) {
      const Fixed distance = approximate_distance(int64_t{body.x} - target->x, int64_t{body.y} - target->y);
      const int64_t rise = int64_t{target->z} + (body.height >> 1) - body.z;
      if (rise < 0 && distance < -3 * rise) body.z = clamped_fixed(int64_t{body.z} - body.float_speed);
      if (rise > 0 && distance < 3 * rise) body.z = clamped_fixed(int64_t{body.z} + body.float_speed);
    }
  }
  const bool missile = body.has(ActorFlag::kMissile) && !body.has(ActorFlag::kNoClip);
  if (body.z <= body.floor_z) {
    if (missile && body.z < body.floor_z && !body.has(ActorFlag::kFloorHugger)) {
      body.z = body.floor_z;
      explode_missile(world_, body, nullptr);
      return;
    }
    // No landing: onto a body, nor of one that jumps onto a ledge while it rises.
    if (player != nullptr && body.velocity_z < 0 && !over_body) {
      // After a jump, and after a fall that was hard enough to bend the knees, the next jump has to wait.
      const bool hard = body.velocity_z < kHardLanding;
      if (player->jump_tics < 0 || hard) player->jump_tics = kJumpDelayTics;
      if (hard) player->view_height_delta = body.velocity_z >> 3;
      hurt_by_landing(world_, body);
    }
    body.z = body.floor_z;
    if (body.has(ActorFlag::kSkullFly)) {
      body.velocity_z = -body.velocity_z;
    } else if (body.velocity_z < 0 || over_body) {
      body.velocity_z = 0;  // also of one that rises and steps onto a body
    }
  } else if (!body.has(ActorFlag::kNoGravity)) {
    const Fixed here = state_.sectors[body.sector_index].gravity;
    int64_t gravity = here == kFracUnit ? state_.gravity : fixed_mul(state_.gravity, here);
    if (body.gravity != kFracUnit) gravity = fixed_mul(static_cast<Fixed>(gravity), body.gravity);
    if (left_ledge && body.velocity_z == 0) gravity *= 2;
    body.velocity_z =
        static_cast<Fixed>(std::max<int64_t>(int64_t{body.velocity_z} - gravity, -to_fixed(1000)));
  }
  if (int64_t{body.z} + body.height > body.ceiling_z) {
    if (missile) {
      body.z = std::max(body.hanging_z(), body.floor_z);
      const Sector& sector = state_.sectors[body.sector_index];
      if (sector.ceiling_texture == "F_SKY1" && !body.has(ActorFlag::kSkyExplode)) {
        world_.remove(body.id);
      } else {
        explode_missile(world_, body, nullptr);
      }
      return;
    }
    if (body.has(ActorFlag::kSkullFly)) body.velocity_z = -body.velocity_z;
    if (body.velocity_z > 0) body.velocity_z = 0;
    body.z = body.hanging_z();  // also where it reaches through the floor, as in ViZDoom
  }
}

MoveResult try_move_monster(World& world, Actor& monster, Fixed x, Fixed y) {
  return Movement(world).try_move_with_result(world.slot_of(monster), x, y);
}

Footing footing_of(const World& world, const Actor& body) {
  Footing footing;
  if (!world.state().has_special_friction) return footing;
  bool found = false;
  const auto stand_on = [&](const Sector& sector) {
    if (!sector.special_friction || body.z > sector.floor_height) return;
    if (found && sector.friction >= footing.friction) return;
    found = true;
    footing = {.friction = sector.friction, .move_factor = sector.move_factor};
  };
  const auto& sectors = world.state().sectors;
  stand_on(sectors[body.sector_index]);
  const Box box = Box::around(body.x, body.y, body.radius);
  world.index().blockmap.for_each_line(box, [&](const BlockLine& line) {
    if (line.back_sector < 0 || !line.crosses(box)) return true;
    stand_on(sectors[static_cast<std::size_t>(line.front_sector)]);
    stand_on(sectors[static_cast<std::size_t>(line.back_sector)]);
    return true;
  });
  return footing;
}

PositionCheck opening_of_point(const World& world, Fixed x, Fixed y) {
  PositionCheck check;
  check.sector_index = check.floor_sector_index = world.index().sectors.sector_at(x, y);
  const Sector& sector = world.state().sectors[check.sector_index];
  check.floor_z = check.ground_z = check.lowest_floor_z = sector.floor_height;
  check.ceiling_z = check.roof_z = sector.ceiling_height;
  return check;
}

bool fits_here(World& world, Actor& actor) {
  if (actor.z < actor.ground_z || int64_t{actor.z} + actor.height > actor.roof_z) return false;
  Movement movement(world);
  const std::size_t slot = world.slot_of(actor);
  const PositionCheck check = actor.player_index >= 0
                                  ? movement.check_walls(slot, actor.x, actor.y)
                                  : movement.check_position(slot, actor.x, actor.y, false);
  return check.fits && int64_t{check.ceiling_z} - check.floor_z >= actor.height;
}

}  // namespace comrad::doom
