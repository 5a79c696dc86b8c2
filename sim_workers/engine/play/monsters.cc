#include "sim_workers/engine/play/monsters.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string_view>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/sight.h"

namespace comrad::doom {
namespace {

constexpr Fixed kCloseRange = to_fixed(64);         // nearer than this nobody goes unnoticed
constexpr Fixed kFriendRange = to_fixed(16 * 128);  // how far friendly monsters look for enemies

/// Steps of one unit, by Direction.
constexpr Fixed kDiagonal = 46341;
constexpr std::array<Fixed, 8> kStepX = {kFracUnit,  kDiagonal,  0, -kDiagonal,
                                         -kFracUnit, -kDiagonal, 0, kDiagonal};
constexpr std::array<Fixed, 8> kStepY = {0, kDiagonal,  kFracUnit,  kDiagonal,
                                         0, -kDiagonal, -kFracUnit, -kDiagonal};

Direction opposite(Direction direction) {
  return direction == kNoDirection ? kNoDirection : static_cast<Direction>((direction + 4) & 7);
}
Angle angle_of(Direction direction) { return static_cast<Angle>(direction) << 29; }

bool is_alive(const Actor& actor) { return actor.health > 0 && !actor.removed; }

/// Turns an eighth of a turn towards the way it walks.
void turn_to_direction(Actor& monster) {
  if (monster.move_direction == kNoDirection) return;
  monster.angle &= 7u << 29;
  const auto difference = static_cast<int32_t>(monster.angle - angle_of(monster.move_direction));
  if (difference > 0) {
    monster.angle -= kAngle45;
  } else if (difference < 0) {
    monster.angle += kAngle45;
  }
}

/// Lines with specials that a body at (x, y) would touch.
struct TouchedLines {
  std::array<uint32_t, 8> lines{};
  std::size_t count = 0;
};
TouchedLines lines_at(World& world, const Actor& body, Fixed x, Fixed y) {
  TouchedLines touched;
  const Box box = Box::around(x, y, body.radius);
  const auto add = [&](const BlockLine& line) {
    if (world.lines()[line.linedef_index].special == 0 || !line.crosses(box)) return true;
    const auto end = touched.lines.begin() + static_cast<std::ptrdiff_t>(touched.count);
    if (std::find(touched.lines.begin(), end, line.linedef_index) == end)
      touched.lines[touched.count++] = line.linedef_index;
    return touched.count < touched.lines.size();
  };
  world.index().blockmap.for_each_line(box, add);
  return touched;
}

/// Walks on in move_direction if it can; then not before some steps does it think again.
bool try_walk(World& world, Actor& monster, Direction direction) {
  monster.move_direction = direction;
  if (!monster_move(world, monster)) return false;
  monster.move_count = world.random_byte() & 15;
  return true;
}

void choose_direction(World& world, Actor& monster, int64_t dx, int64_t dy) {
  const Direction old_direction = monster.move_direction;
  const Direction back = opposite(old_direction);
  constexpr int64_t kNear = to_fixed(10);
  Direction along_x = dx > kNear ? kEast : dx < -kNear ? kWest : kNoDirection;
  Direction along_y = dy > kNear ? kNorth : dy < -kNear ? kSouth : kNoDirection;

  // Straight there.
  if (along_x != kNoDirection && along_y != kNoDirection) {
    const Direction diagonal =
        dy > 0 ? (dx > 0 ? kNorthEast : kNorthWest) : (dx > 0 ? kSouthEast : kSouthWest);
    monster.move_direction = diagonal;
    if (diagonal != back && try_walk(world, monster, diagonal)) return;
  }
  // Along one axis, usually the longer one first.
  if (world.random_byte() > 200 || std::abs(dy) > std::abs(dx)) std::swap(along_x, along_y);
  for (const Direction direction : {along_x, along_y})
    if (direction != kNoDirection && direction != back && try_walk(world, monster, direction)) return;
  // No direct way: on as before, then anywhere, at last back.
  if (old_direction != kNoDirection && try_walk(world, monster, old_direction)) return;
  const bool rising = (world.random_byte() & 1) != 0;
  for (int i = 0; i < 8; ++i) {
    const auto direction = static_cast<Direction>(rising ? i : 7 - i);
    if (direction != back && try_walk(world, monster, direction)) return;
  }
  if (back != kNoDirection && try_walk(world, monster, back)) return;
  monster.move_direction = kNoDirection;
}

/// Is `other` where the monster could notice it?
bool is_visible(World& world, const Actor& monster, const Actor& other, const LookRange& range) {
  const Fixed distance = distance_between(monster, other);
  if (range.nearest > 0 && distance < range.nearest) return false;
  if (range.farthest > 0 && distance > range.farthest) return false;
  if (!range.all_around) {
    const Angle half = range.field_of_view != 0 ? range.field_of_view / 2 : kAngle90;
    const Angle angle = angle_between(monster, other) - monster.angle;
    const bool in_view = angle <= half || angle >= Angle{0} - half;
    if (!in_view && (range.field_of_view != 0 || distance > kCloseRange)) return false;  // behind its back
  }
  return can_notice(world, monster, other);
}

bool can_be_enemy(const Actor& monster, const Actor& other) {
  return &other != &monster && !other.removed && other.has(ActorFlag::kShootable) && other.health > 0 &&
         !other.has(ActorFlag::kDormant) && !other.has(ActorFlag::kNeverTarget);
}

/// The goal of its patrol, or who it fought before.
bool look_for_old_aims(World& world, Actor& monster) {
  if (monster.target_id == 0 || target_of(world, monster) == nullptr) {
    if (Actor* goal = world.actor(monster.goal_id)) {
      monster.target_id = goal->id;
      return true;
    }
    if (Actor* enemy = world.actor(monster.last_enemy_id); enemy != nullptr && is_alive(*enemy)) {
      if (!is_friend(monster, *enemy)) {
        monster.target_id = enemy->id;
        monster.last_enemy_id = 0;
        return true;
      }
    }
  }
  return monster.goal_id != 0 && monster.target_id == monster.goal_id;
}

bool look_for_hated(World& world, Actor& monster, const LookRange& range) {
  // The search continues behind the last one found, and starts over once.
  const Actor* present = target_of(world, monster);
  const uint32_t before =
      present != nullptr && present->thing_id == monster.hate_thing_id ? present->thing_order : UINT32_MAX;
  Actor* other = world.find_thing(monster.hate_thing_id, before);
  bool wrapped = before == UINT32_MAX;
  while (true) {
    if (other == nullptr) {
      if (wrapped) break;
      wrapped = true;
      other = world.find_thing(monster.hate_thing_id);
      continue;
    }
    if (can_be_enemy(monster, *other) &&
        (monster.has(ActorFlag::kNoSightCheck) || is_visible(world, monster, *other, range))) {
      if (monster.goal_id != 0 && monster.target_id == monster.goal_id) monster.reaction_tics = 0;
      monster.target_id = other->id;
      return true;
    }
    if (wrapped && other->thing_order == before) break;
    other = world.find_thing(monster.hate_thing_id, other->thing_order);
  }
  return look_for_old_aims(world, monster);
}

/// For a friendly monster: the nearest enemy that it sees.
bool look_for_enemies(World& world, Actor& monster) {
  // Cheap tests first; only one that is nearer than the best so far is looked at.
  Actor* best = nullptr;
  Fixed best_distance = kFriendRange;
  for (Actor& other : world.state().actors) {
    if (!other.has(ActorFlag::kIsMonster) || other.has(ActorFlag::kFriendly)) continue;
    if (!can_be_enemy(monster, other)) continue;
    const Fixed distance = distance_between(monster, other);
    if (distance >= best_distance || !can_notice(world, monster, other)) continue;
    best = &other, best_distance = distance;
  }
  if (best == nullptr) return false;
  monster.target_id = best->id;
  return true;
}

/// A friendly monster without enemies follows a player.
bool follow_player(World& world, Actor& monster) {
  const int count = world.player_count();
  const int first = static_cast<int>(world.rng().below(static_cast<uint32_t>(count)));
  for (int i = 0; i < count; ++i) {
    const Actor* body = world.body_of((first + i) % count);
    if (body == nullptr || body->health <= 0) continue;
    monster.target_id = body->id;
    return true;
  }
  return false;
}

bool is_blade(const World& world, const Player& player) {
  return player.ready_weapon != kNoType &&
         world.catalog()[player.ready_weapon].flags.has(ActorFlag::kWeaponMelee);
}

/// It is at a point of its patrol: runs the specials bound to it, then on to the next point. True when
/// it arrived.
bool arrive_at_goal(World& world, Actor& monster, Actor& goal) {
  const uint32_t target_id = monster.target_id;
  monster.target_id = goal.id;
  const bool arrived = check_melee_range(world, monster);
  monster.target_id = target_id;
  if (!arrived) return false;
  const bool was_target = monster.target_id == goal.id;
  const int32_t goal_thing_id = goal.thing_id, next_thing_id = goal.args[0], wait_seconds = goal.args[1];
  if (goal_thing_id != 0) {
    for (Actor* spot = world.find_thing(goal_thing_id); spot != nullptr;
         spot = world.find_thing(goal_thing_id, spot->thing_order)) {
      if (spot->special == 0 || !world.catalog().is_a(spot->type, "PatrolSpecial")) continue;
      world.events().run_special(world, {.number = spot->special, .args = spot->args, .activator = &monster});
    }
  }
  Actor* next = next_thing_id != 0 ? world.find_thing(next_thing_id) : nullptr;
  while (next != nullptr && !world.catalog().is_a(next->type, "PatrolPoint"))
    next = world.find_thing(next_thing_id, next->thing_order);
  if (monster.removed) return true;
  bool waits = false;
  if (next != nullptr && was_target) {
    // It stays idle until then.
    const int64_t seconds = std::clamp<int32_t>(wait_seconds, 0, 1 << 20);
    monster.reaction_tics = static_cast<int32_t>(std::min<int64_t>(
        seconds * 35 + static_cast<int64_t>(std::min<uint64_t>(world.tic_count(), 1u << 30)), INT32_MAX));
    waits = seconds > 0;
  }
  if (was_target) monster.target_id = 0;
  monster.set(ActorFlag::kJustAttacked);
  monster.goal_id = next != nullptr ? next->id : 0;
  if (waits) {
    monster.set(ActorFlag::kInCombat);
    set_idle(world, monster);
  }
  return true;
}

/// chase() without its guard against being called from within itself.
void chase_once(World& world, Actor& monster, const ChaseOptions& options) {
  if (monster.reaction_tics > 0) --monster.reaction_tics;
  Actor* target = target_of(world, monster);
  const auto is_goal = [&](const Actor* actor) {
    return actor != nullptr && monster.goal_id != 0 && actor->id == monster.goal_id;
  };
  if (target != nullptr && target->has(ActorFlag::kInvisible) && !is_goal(target) &&
      !monster.has(ActorFlag::kSeeInvisible))
    monster.target_id = 0, target = nullptr;
  if (monster.threshold > 0) {
    if (target == nullptr || target->health <= 0) {
      monster.threshold = 0;
    } else {
      --monster.threshold;
    }
  }
  turn_to_direction(monster);

  // Whom?
  if (target != nullptr && !is_goal(target) && target->health <= 0) monster.target_id = 0, target = nullptr;
  if (target == nullptr || (!target->has(ActorFlag::kShootable) && !is_goal(target))) {
    if (target != nullptr && target->has(ActorFlag::kNonShootable)) {
      monster.last_enemy_id = target->id;  // it cannot be hurt for now
      monster.threshold = 0;
    }
    if (look_for_players(world, monster, true) && monster.target_id != monster.goal_id) return;
    target = target_of(world, monster);
    if (target == nullptr) {
      monster.target_id = 0;
      if (!monster.has(ActorFlag::kFriendly)) {
        set_idle(world, monster);
      } else if (!options.stands) {
        wander(world, monster);
      }
      return;
    }
  }

  // Never two attacks in a row.
  if (monster.has(ActorFlag::kJustAttacked)) {
    monster.set(ActorFlag::kJustAttacked, false);
    if (!is_fast(world, monster) && !options.stands) new_chase_direction(world, monster);
    return;
  }

  Actor* goal = world.actor(monster.goal_id);
  const bool walks_to_goal = goal != nullptr && (goal == target || monster.has(ActorFlag::kOnlyChaseGoal));
  if (walks_to_goal && arrive_at_goal(world, monster, *goal)) return;
  if (goal == nullptr || goal != target) {
    // The frightened rarely fight.
    const bool fights = !monster.has(ActorFlag::kFrightened) || world.random_byte() < 43;
    if (fights && options.melee_state != kNoState && check_melee_range(world, monster)) {
      set_state(world, monster, options.melee_state);
      return;
    }
    if (fights && options.missile_state != kNoState && (monster.move_count == 0 || is_fast(world, monster)) &&
        check_missile_range(world, monster)) {
      monster.set(ActorFlag::kJustAttacked);
      monster.set(ActorFlag::kInCombat);
      set_state(world, monster, options.missile_state);
      return;
    }
  }

  // With several enemies to choose from, one that it sees is better.
  if ((world.is_multiplayer() || monster.hate_thing_id != 0) && monster.threshold == 0 &&
      !can_see(world, monster, *target)) {
    const uint32_t old_target = monster.target_id;
    const bool needs_no_sight = monster.has(ActorFlag::kNoSightCheck);
    monster.set(ActorFlag::kNoSightCheck, false);
    const bool found = look_for_players(world, monster, true);
    monster.set(ActorFlag::kNoSightCheck, needs_no_sight);
    if (found && monster.target_id != old_target) return;
  }

  if (options.stands) return;
  --monster.move_count;
  if (monster.move_count < 0 || !monster_move(world, monster)) {
    if (!monster.removed) new_chase_direction(world, monster);
  }
}

}  // namespace

Actor* target_of(World& world, const Actor& actor) {
  return actor.target_id != 0 ? world.actor(actor.target_id) : nullptr;
}

Fixed distance_between(const Actor& from, const Actor& to) {
  const int64_t dx = std::abs(int64_t{to.x} - from.x), dy = std::abs(int64_t{to.y} - from.y);
  return clamped_fixed(std::max(dx, dy) + std::min(dx, dy) / 2);
}

Angle angle_between(const Actor& from, const Actor& to) { return angle_to(from.x, from.y, to.x, to.y); }

bool is_friend(const Actor& one, const Actor& other) {
  const auto friendly = [](const Actor& actor) {
    return actor.player_index >= 0 || actor.has(ActorFlag::kFriendly);
  };
  return friendly(one) && friendly(other);
}

bool is_fast(const World& world, const Actor& monster) {
  return world.is_fast() || monster.has(ActorFlag::kAlwaysFast);
}

bool may_turn_against(World& world, Actor& monster, const Actor& other) {
  const auto rival_of = [&](const Actor& actor) {  // enemies by their sides, not by accident
    const bool one = monster.player_index >= 0 || monster.has(ActorFlag::kFriendly);
    const bool two = actor.player_index >= 0 || actor.has(ActorFlag::kFriendly);
    return one != two;
  };
  if (&other == &monster || other.removed) return false;
  if (other.has(ActorFlag::kNeverTarget) || !other.has(ActorFlag::kShootable)) return false;
  const Actor* target = target_of(world, monster);
  if (monster.has(ActorFlag::kNoTargetSwitch) && target != nullptr) return false;
  if (other.has(ActorFlag::kNoTarget) &&
      (monster.hate_thing_id == 0 || other.thing_id != monster.hate_thing_id) && !rival_of(other))
    return false;
  if (monster.threshold != 0 && !monster.has(ActorFlag::kQuickToRetaliate)) return false;
  if (is_friend(monster, other)) return false;
  if (monster.has(ActorFlag::kNoInfighting) && other.player_index < 0 && !rival_of(other)) return false;
  if (monster.hate_thing_id != 0 && monster.hate_thing_id == other.hate_thing_id)
    return false;  // of one party
  if (monster.has(ActorFlag::kNoHatePlayers) && other.player_index >= 0) return false;
  // What it hates it does not give up at once.
  return !(target != nullptr && target->health > 0 && monster.hate_thing_id != 0 &&
           target->thing_id == monster.hate_thing_id && world.random_byte() < 128 &&
           can_see(world, monster, *target));
}

bool check_melee_range(World& world, Actor& monster) {
  Actor* target = target_of(world, monster);
  if (target == nullptr) return false;
  const int64_t reach = int64_t{world.type_of(monster).melee_range} + target->radius;
  if (distance_between(monster, *target) >= reach) return false;
  if (monster.goal_id != 0 && target->id == monster.goal_id) return true;
  if (!monster.has(ActorFlag::kNoVerticalMeleeRange) &&
      (target->z > int64_t{monster.z} + monster.height || int64_t{target->z} + target->height < monster.z))
    return false;
  return !is_friend(monster, *target) && can_see(world, monster, *target);
}

bool check_missile_range(World& world, Actor& monster) {
  Actor* target = target_of(world, monster);
  if (target == nullptr || !can_see(world, monster, *target)) return false;
  if (monster.has(ActorFlag::kJustHit)) {  // it was hit a moment ago and strikes back
    monster.set(ActorFlag::kJustHit, false);
    return !is_friend(monster, *target);
  }
  if (monster.reaction_tics > 0 || is_friend(monster, *target)) return false;

  const ActorType& type = world.type_of(monster);
  const bool has_melee = type.state(StateLabel::kMelee) != kNoState;
  int64_t distance = int64_t{distance_between(monster, *target)} - to_fixed(64);
  if (!has_melee) distance -= to_fixed(128);  // who cannot bite shoots more
  if (type.max_target_range > 0 && distance > type.max_target_range) return false;
  if (has_melee && distance < type.melee_threshold) return false;
  if (monster.has(ActorFlag::kMissileMore)) distance >>= 1;
  if (monster.has(ActorFlag::kMissileEvenMore)) distance >>= 3;
  return world.random_byte() >= std::min<int64_t>(distance >> kFracBits, type.min_missile_chance);
}

bool monster_move(World& world, Actor& monster) {
  if (monster.move_direction >= kNoDirection) return false;
  if (!monster.has(ActorFlag::kNoGravity) && monster.z > monster.floor_z) return false;  // in the air

  // A step longer than the body is made in parts.
  const auto direction = static_cast<std::size_t>(monster.move_direction);
  const Fixed start_x = monster.x, start_y = monster.y;
  const int64_t dx = (int64_t{monster.speed} * kStepX[direction]) >> kFracBits;
  const int64_t dy = (int64_t{monster.speed} * kStepY[direction]) >> kFracBits;
  const int64_t part_max = int64_t{monster.radius} - kFracUnit;
  int64_t parts = 1;
  if (part_max > 0) parts += std::min<int64_t>(std::abs(int64_t{monster.speed}) / part_max, 1024);
  MoveResult step{.moved = true};
  Fixed x = start_x, y = start_y;
  for (int64_t part = 1; part <= parts && step.moved; ++part) {
    x = clamped_fixed(start_x + dx * part / parts), y = clamped_fixed(start_y + dy * part / parts);
    step = try_move_monster(world, monster, x, y);
    if (monster.removed) return true;
    if (step.moved && (monster.x != x || monster.y != y)) return true;  // a line sent it elsewhere
  }

  if (step.moved) {
    monster.set(ActorFlag::kInFloat, false);
    // Down a stair at once, instead of falling.
    if (!monster.has(ActorFlag::kNoGravity) && monster.z > monster.floor_z &&
        int64_t{monster.z} - monster.floor_z <= world.type_of(monster).max_step_height)
      monster.z = monster.floor_z;
    return true;
  }
  if (monster.has(ActorFlag::kFloat) && step.float_ok) {
    const Fixed old_z = monster.z;
    monster.z = clamped_fixed(int64_t{monster.z} +
                              (monster.z < step.floor_z ? monster.float_speed : -monster.float_speed));
    if (fits_here(world, monster)) {
      monster.set(ActorFlag::kInFloat);
      return true;
    }
    monster.z = old_z;
  }

  // A door, perhaps. What blocks it and opens is worth waiting for; another line that it happened to open
  // seldom is.
  const TouchedLines touched = lines_at(world, monster, x, y);
  if (touched.count == 0) return false;
  monster.move_direction = kNoDirection;
  bool opened_blocking = false, opened_other = false;
  for (std::size_t i = touched.count; i-- > 0;) {
    bool worked = false;
    if (monster.has(ActorFlag::kCanUseWalls))
      worked = world.events().activate_line(world, touched.lines[i], monster, false, Activation::kMonsterUse);
    if (!monster.removed && monster.has(ActorFlag::kPushWall))
      worked |= world.events().activate_line(world, touched.lines[i], monster, false, Activation::kPush);
    if (monster.removed) return true;
    const bool blocking = static_cast<int32_t>(touched.lines[i]) == step.blocking_line;
    opened_blocking |= worked && blocking;
    opened_other |= worked && !blocking;
  }
  if (!opened_blocking && !opened_other) return false;
  return (world.random_byte() < 203) == opened_blocking;
}

void new_chase_direction(World& world, Actor& monster) {
  const Actor* aim = target_of(world, monster);
  const Actor* goal = world.actor(monster.goal_id);
  if (goal != nullptr && monster.has(ActorFlag::kOnlyChaseGoal)) aim = goal;
  if (aim == nullptr) {
    random_chase_direction(world, monster);
    return;
  }
  int64_t dx = int64_t{aim->x} - monster.x, dy = int64_t{aim->y} - monster.y;
  if (aim != goal) {
    bool flees = monster.has(ActorFlag::kFrightened);
    if (!flees && monster.has(ActorFlag::kAvoidMelee)) {
      // It keeps out of the reach of fists and claws.
      const Fixed distance = distance_between(monster, *aim);
      const Player* player = world.player_of(*aim);
      const ActorType& type = world.type_of(*aim);
      flees = player != nullptr
                  ? is_blade(world, *player) && distance < to_fixed(3 * 64)
                  : type.state(StateLabel::kMelee) != kNoState && distance < type.melee_range + to_fixed(60);
    }
    if (flees) dx = -dx, dy = -dy;
  }
  choose_direction(world, monster, dx, dy);
}

void random_chase_direction(World& world, Actor& monster) {
  const Direction old_direction = monster.move_direction;
  const Direction back = opposite(old_direction);
  if (old_direction != kNoDirection && world.random_byte() < 150 && try_walk(world, monster, old_direction))
    return;
  const int turn = (world.random_byte() & 1) != 0 ? 7 : 1;
  const int first = old_direction != kNoDirection ? old_direction : world.random_byte() & 7;
  for (int i = 1; i < 8; ++i) {
    const auto direction = static_cast<Direction>((first + i * turn) & 7);
    if (direction != back && try_walk(world, monster, direction)) return;
  }
  if (back != kNoDirection && try_walk(world, monster, back)) return;
  monster.move_direction = kNoDirection;
}

bool look_for_players(World& world, Actor& monster, bool all_around) {
  return look_for_players(world, monster, LookRange{.all_around = all_around});
}

bool look_for_players(World& world, Actor& monster, const LookRange& range) {
  if (monster.hate_thing_id != 0) {
    if (look_for_hated(world, monster, range)) return true;
    if (!monster.has(ActorFlag::kHuntPlayers)) return false;
  }
  if (monster.has(ActorFlag::kFriendly))
    return look_for_enemies(world, monster) || look_for_old_aims(world, monster) ||
           (!monster.has(ActorFlag::kStandStill) && monster.speed != 0 && follow_player(world, monster));

  const int count = world.player_count();
  const int first = std::clamp(monster.last_look_player, 0, count - 1);
  for (int i = 0; i < count; ++i) {
    const int index = (first + i) % count;
    Actor* body = world.body_of(index);
    const Player& player = world.player(index);
    if (body == nullptr || !body->has(ActorFlag::kShootable) || body->health <= 0 || player.no_target)
      continue;
    if (!is_visible(world, monster, *body, range)) continue;
    if (body->has(ActorFlag::kShadow) || body->has(ActorFlag::kGhost)) {
      // A blurred player who stands still far off is missed, and a moving one most of the time.
      const int64_t speed = std::abs(int64_t{body->velocity_x}) + std::abs(int64_t{body->velocity_y});
      if (distance_between(monster, *body) > 2 * kCloseRange && speed < to_fixed(5)) continue;
      if (world.random_byte() < 225) continue;
    }
    if (monster.goal_id != 0 && monster.target_id == monster.goal_id) monster.reaction_tics = 0;
    monster.target_id = body->id;
    monster.last_look_player = (index + 1) % count;
    return true;
  }
  return look_for_old_aims(world, monster);
}

void face_target(World& world, Actor& monster) {
  const Actor* target = target_of(world, monster);
  if (target == nullptr) return;
  monster.set(ActorFlag::kAmbush, false);
  monster.angle = angle_between(monster, *target);
  if (target->has(ActorFlag::kShadow) && !monster.has(ActorFlag::kSeeInvisible))
    monster.angle += static_cast<Angle>(world.random_triangle()) << 21;
}

void set_idle(World& world, Actor& actor) {
  const ActorType& type = world.type_of(actor);
  const uint32_t idle = type.state(StateLabel::kIdle);
  set_state(world, actor, idle != kNoState ? idle : type.state(StateLabel::kSpawn));
}

void chase(World& world, Actor& monster, const ChaseOptions& options) {
  // A state that a chase enters may chase at once; once per call is enough.
  if (monster.has(ActorFlag::kInChase) || monster.has(ActorFlag::kDormant)) return;
  monster.set(ActorFlag::kInChase);
  chase_once(world, monster, options);
  monster.set(ActorFlag::kInChase, false);
}

void wander(World& world, Actor& monster) {
  monster.set(ActorFlag::kInCombat, false);
  if (monster.has(ActorFlag::kStandStill) || monster.has(ActorFlag::kDormant)) return;
  if (monster.reaction_tics > 0) {
    --monster.reaction_tics;
    return;
  }
  turn_to_direction(monster);
  --monster.move_count;
  if (monster.move_count < 0 || !monster_move(world, monster)) {
    if (monster.removed) return;
    random_chase_direction(world, monster);
    monster.move_count += 5;
  }
}

void boss_death(World& world, Actor& boss) {
  // Somebody has to be alive to enjoy it, and it has to be the last of its kind.
  bool player_lives = false;
  for (int player = 0; player < world.player_count(); ++player)
    player_lives |= world.player(player).health > 0;
  if (!player_lives) return;
  for (const Actor& other : world.actors())
    if (other.id != boss.id && !other.removed && other.type == boss.type && other.health > 0) return;

  struct Rule {
    std::string_view level, monster;
    Special special;
    std::array<int32_t, 5> args;
  };
  static constexpr std::array<Rule, 7> kRules = {{
      {"MAP07", "Fatso", Special::kFloor_LowerToLowest, {666, 8}},
      {"MAP07", "Arachnotron", Special::kFloor_RaiseByTexture, {667, 8}},
      {"E1M8", "BaronOfHell", Special::kFloor_LowerToLowest, {666, 8}},
      {"E2M8", "Cyberdemon", Special::kExit_Normal, {}},
      {"E3M8", "SpiderMastermind", Special::kExit_Normal, {}},
      {"E4M6", "Cyberdemon", Special::kDoor_Open, {666, 64}},
      {"E4M8", "SpiderMastermind", Special::kFloor_LowerToLowest, {666, 8}},
  }};
  for (const Rule& rule : kRules)
    if (rule.level == world.level().name && world.catalog().is_a(boss.type, rule.monster))
      world.events().run_special(world, {.number = rule.special, .args = rule.args});
}

void skull_struck(World& world, Actor& skull, Actor* struck) {
  skull.set(ActorFlag::kSkullFly, false);
  skull.velocity_x = skull.velocity_y = skull.velocity_z = 0;
  if (skull.health <= 0) return;
  if (skull.has(ActorFlag::kDormant)) {
    set_idle(world, skull);
    skull.tics = -1;
    return;
  }
  if (struck != nullptr) {
    const int32_t damage = roll_damage(world, skull.damage);
    damage_actor(world, *struck, &skull, &skull, damage);
    if (skull.health <= 0 || skull.removed) return;  // what it bit exploded
  }
  if (!set_label(world, skull, StateLabel::kSee) && !skull.removed) set_idle(world, skull);
}

}  // namespace comrad::doom
