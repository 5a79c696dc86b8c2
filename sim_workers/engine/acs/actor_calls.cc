#include "sim_workers/engine/acs/actor_calls.h"

#include <algorithm>
#include <cmath>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/actor_properties.h"
#include "sim_workers/engine/acs/strings.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"

namespace comrad::doom::acs {
namespace {

constexpr Fixed kMapEdge = to_fixed(32000);

// Bits of ClassifyActor.
enum ActorClass : int32_t {
  kNobody = 0,
  kWorld = 1,
  kPlayer = 2,
  kMonster = 16,
  kAlive = 32,
  kDead = 64,
  kMissile = 128,
  kGeneric = 256
};

// Bits of Warp.
enum WarpFlag : uint32_t {
  kAbsoluteOffset = 0x1,
  kAbsoluteAngle = 0x2,
  kUseOwnAngle = 0x4,
  kNoCheckPosition = 0x8,
  kStop = 0x80,
  kToFloor = 0x100,
  kTestOnly = 0x200,
  kAbsolutePosition = 0x400,
  kCopyVelocity = 0x4000,
  kCopyPitch = 0x8000,
};

void spawn_fog(World& world, const Actor& at) {
  const uint32_t fog = world.catalog().known().teleport_fog;
  if (fog != kNoType) world.spawn_unchecked(fog, at.x, at.y, at.z, at.angle);
}

// The players that an inventory call is about; other actors carry nothing here.
template <typename Visit>
void each_owner(const Caller& caller, const Actor* actor, bool everyone, Visit visit) {
  if (everyone) {
    for (int player = 0; player < caller.world.player_count(); ++player) visit(player);
  } else if (actor != nullptr && actor->player_index >= 0) {
    visit(actor->player_index);
  } else if (actor != nullptr) {
    caller.unsupported(kWarnMonsterInventory, "inventory of an actor that is no player");
  }
}

bool is_armor(std::string_view name) {
  return same_ignoring_case(name, "Armor") || same_ignoring_case(name, "BasicArmor");
}

}  // namespace

bool on_map(Fixed x, Fixed y, Fixed z) {
  const auto inside = [](Fixed value) { return value >= -kMapEdge && value <= kMapEdge; };
  return inside(x) && inside(y) && (inside(z) || z == kOnFloor || z == kOnCeiling);
}

// ---------------------------------------------------------------- making and moving

int32_t spawn_thing(const Caller& caller, int32_t type_name, Fixed x, Fixed y, Fixed z, int32_t thing_id,
                    Angle angle, bool force) {
  const std::optional<uint32_t> named = caller.type_named(type_name);
  if (!named || !on_map(x, y, z)) return 0;
  World& world = caller.world;
  const uint32_t type = world.catalog().replacement(*named);
  if (world.options().no_monsters && world.catalog()[type].flags.has(ActorFlag::kIsMonster)) return 0;
  return spawn_actor(world, type, x, y, z, angle, thing_id, force).has_value() ? 1 : 0;
}

constexpr Angle kByteAngleMask = 0xFF000000;  // scripts hand angles on as bytes

int32_t spawn_at_spots(const Caller& caller, int32_t type_name, int32_t spot_id, int32_t thing_id,
                       Angle angle, bool facing, bool force) {
  int32_t count = 0;
  caller.each_actor(spot_id, [&](Actor& spot) {
    count += spawn_thing(caller, type_name, spot.x, spot.y, spot.z, thing_id,
                         facing ? spot.angle & kByteAngleMask : angle, force);
  });
  return count;
}

int32_t spawn_projectile(const Caller& caller, int32_t source_id, uint32_t named, Angle angle, int32_t speed,
                         int32_t rise, int32_t gravity, int32_t new_thing_id) {
  World& world = caller.world;
  const uint32_t type = world.catalog().replacement(named);
  const ActorFlags& type_flags = world.catalog()[type].flags;
  if (world.options().no_monsters && type_flags.has(ActorFlag::kIsMonster)) return 0;
  const auto velocity = [](int32_t eighths) { return clamped_fixed(int64_t{eighths} * (kFracUnit / 8)); };
  int32_t count = 0;
  caller.each_actor(source_id, [&](Actor& source) {
    const Fixed z = type_flags.has(ActorFlag::kFloorHugger)     ? kOnFloor
                    : type_flags.has(ActorFlag::kCeilingHugger) ? kOnCeiling
                                                                : source.z;
    Actor& made = world.spawn_unchecked(type, source.x, source.y, z, angle);
    if (new_thing_id != 0) world.set_thing_id(made, new_thing_id);
    made.target_id = source.id;
    made.velocity_x = fixed_mul(velocity(speed), fine_cosine(angle));
    made.velocity_y = fixed_mul(velocity(speed), fine_sine(angle));
    made.velocity_z = velocity(rise);
    const double x = made.velocity_x, y = made.velocity_y, z_speed = made.velocity_z;
    made.speed = static_cast<Fixed>(std::min(std::sqrt(x * x + y * y + z_speed * z_speed), 2e9));
    if (gravity != 0) {
      made.set(ActorFlag::kNoGravity, false);
      if (gravity == 1) made.gravity = kFracUnit / 8;
    } else {
      made.set(ActorFlag::kNoGravity);
    }
    if (made.has(ActorFlag::kMissile)) {
      if (check_missile_spawn(world, made, source.radius)) ++count;
    } else if (fits_here(world, made)) {
      ++count;
    } else {
      world.remove(made.id);
    }
  });
  return count;
}

bool set_position(const Caller& caller, Actor& actor, Fixed x, Fixed y, Fixed z, bool fog) {
  if (!on_map(x, y, z)) return false;
  World& world = caller.world;
  const Fixed old_x = actor.x, old_y = actor.y, old_z = actor.z;
  if (!put_where_it_fits(world, actor, x, y, z)) return false;
  if (fog) {
    spawn_fog(world, actor);
    if (world.catalog().known().teleport_fog != kNoType)
      world.spawn_unchecked(world.catalog().known().teleport_fog, old_x, old_y, old_z, actor.angle);
  }
  return true;
}

int32_t warp(const Caller& caller, std::span<const int32_t> args) {
  const auto arg = [&](std::size_t index) { return index < args.size() ? args[index] : 0; };
  World& world = caller.world;
  Actor* self = caller.activator();
  const Actor* there = caller.one_actor(arg(0));
  const auto flags = static_cast<uint32_t>(arg(5));
  if (self == nullptr || there == nullptr) return 0;

  Angle angle = to_angle(arg(4));
  if ((flags & kAbsoluteAngle) == 0) angle += (flags & kUseOwnAngle) != 0 ? self->angle : there->angle;
  int64_t x = arg(1), y = arg(2), z = arg(3);
  if ((flags & kAbsolutePosition) == 0) {
    if ((flags & kAbsoluteOffset) == 0) {  // forward and to the right of the angle
      const Fixed sine = fine_sine(angle), cosine = fine_cosine(angle);
      const int64_t forward = x, side = y;
      x = (forward * cosine + side * sine) >> kFracBits;
      y = (forward * sine - side * cosine) >> kFracBits;
    }
    x += there->x, y += there->y, z += there->z;
  }
  const Fixed new_x = clamped_fixed(x), new_y = clamped_fixed(y);
  if (!on_map(new_x, new_y, clamped_fixed(z))) return 0;
  const Fixed old_x = self->x, old_y = self->y, old_z = self->z;
  Fixed new_z = clamped_fixed(z);
  if ((flags & kToFloor) != 0)
    new_z = clamped_fixed(int64_t{world.sectors()[world.sector_at(new_x, new_y)].floor_height} +
                          ((flags & kAbsolutePosition) != 0 ? 0 : arg(3)));
  set_position(world, self->id, new_x, new_y, new_z);
  const bool fits = (flags & kNoCheckPosition) != 0 || fits_here(world, *self);
  if (!fits || (flags & kTestOnly) != 0) {
    set_position(world, self->id, old_x, old_y, old_z);
    return fits ? 1 : 0;
  }
  world.set_angle(self->id, angle);
  if ((flags & kStop) != 0) self->velocity_x = self->velocity_y = self->velocity_z = 0;
  if ((flags & kCopyVelocity) != 0)
    self->velocity_x = there->velocity_x, self->velocity_y = there->velocity_y,
    self->velocity_z = there->velocity_z;
  if ((flags & kCopyPitch) != 0) self->pitch = there->pitch;
  if (args.size() > 6) {
    const uint32_t state = find_state(caller, *self, caller.text(args[6]), arg(7) != 0);
    if (state != kNoState) set_state(world, *self, state);
  }
  return 1;
}

int32_t pick_actor(const Caller& caller, std::span<const int32_t> args) {
  constexpr uint32_t kForceId = 1, kReturnId = 2;
  const auto arg = [&](std::size_t index) { return index < args.size() ? args[index] : 0; };
  World& world = caller.world;
  Actor* source = caller.one_actor(arg(0));
  if (source == nullptr) return 0;
  const Angle angle = to_angle(arg(1)), pitch = to_angle(arg(2));
  const int64_t distance = std::clamp<int64_t>(arg(3), 0, to_fixed(4096));
  const int64_t flat = (distance * fine_cosine(pitch)) >> kFracBits;
  const int64_t drop = (distance * fine_sine(pitch)) >> kFracBits;
  const auto dx = static_cast<Fixed>((flat * fine_cosine(angle)) >> kFracBits);
  const auto dy = static_cast<Fixed>((flat * fine_sine(angle)) >> kFracBits);
  const int64_t eye = int64_t{source->z} + source->height / 2 + to_fixed(8);
  Actor* found = nullptr;
  trace_path(world, source->x, source->y, dx, dy, true, true, [&](const PathCrossing& crossing) {
    const int64_t z = eye - ((drop * crossing.fraction) >> kFracBits);
    if (crossing.line >= 0) {
      const auto line = static_cast<uint32_t>(crossing.line);
      if (!world.level().linedefs[line].back.has_value()) return false;
      if ((world.lines()[line].flags & (kLineBlockEverything | kLineBlockHitscan)) != 0) return false;
      const Opening opening = opening_of(world, line);
      return z > opening.bottom && z < opening.top;
    }
    Actor* actor = crossing.actor;
    if (actor == nullptr || actor == source || !actor->has(ActorFlag::kShootable)) return true;
    if (z < actor->z || z > int64_t{actor->z} + actor->height) return true;
    found = actor;
    return false;
  });
  const auto flags = static_cast<uint32_t>(arg(7));
  if (found == nullptr) return 0;
  if ((flags & kForceId) == 0 && arg(4) == 0 && found->thing_id == 0) return 0;
  if (found->thing_id == 0 || (flags & kForceId) != 0) world.set_thing_id(*found, arg(4));
  return (flags & kReturnId) != 0 ? found->thing_id : 1;
}

uint32_t find_state(const Caller& caller, const Actor& actor, std::string_view label, bool exact) {
  const ActorType& type = caller.world.type_of(actor);
  std::string name = lower_case(label);
  while (!name.empty()) {
    const uint32_t state = type.find_label(name);
    if (state != kNoState || exact) return state;
    const std::size_t dot = name.rfind('.');
    if (dot == std::string::npos) return kNoState;
    name.resize(dot);
  }
  return kNoState;
}

int32_t set_actor_state(const Caller& caller, int32_t thing_id, int32_t label, bool exact) {
  int32_t count = 0;
  caller.each_actor(thing_id, [&](Actor& actor) {
    const uint32_t state = find_state(caller, actor, caller.text(label), exact);
    if (state == kNoState) return;
    set_state(caller.world, actor, state);
    ++count;
  });
  return count;
}

int32_t damage_thing(const Caller& caller, int32_t thing_id, int32_t amount, int32_t type_name) {
  const DamageType type =
      caller.world.catalog().find_damage_type(caller.text(type_name)).value_or(DamageType::kNormal);
  return caller.each_actor(thing_id, [&](Actor& actor) {
    if (amount > 0) {
      if (actor.has(ActorFlag::kShootable))
        damage_actor(caller.world, actor, nullptr, caller.activator(), amount, type);
    } else if (amount < 0 && actor.health > 0) {
      heal_actor(caller.world, actor, amount == INT32_MIN ? INT32_MAX : -amount);
    }
  });
}

// ---------------------------------------------------------------- counting

int32_t count_things(const Caller& caller, uint32_t kind, int32_t thing_id, int32_t sector_tag) {
  const World& world = caller.world;
  int32_t count = 0;
  for (const Actor& actor : world.actors()) {
    if (actor.removed || actor.health <= 0 || (thing_id != 0 && actor.thing_id != thing_id)) continue;
    if (kind != kNoType && actor.type != kind) continue;
    if (sector_tag != -1 && world.sectors()[actor.sector_index].tag != sector_tag) continue;
    ++count;
  }
  return count;
}

namespace {

// What replaces a type counts where the type itself has none.
int32_t count_with_replacement(const Caller& caller, uint32_t kind, int32_t thing_id, int32_t sector_tag) {
  const int32_t count = count_things(caller, kind, thing_id, sector_tag);
  const uint32_t replacement = caller.world.catalog().replacement(kind);
  return count != 0 || replacement == kind ? count : count_things(caller, replacement, thing_id, sector_tag);
}

}  // namespace

int32_t count_things_by_number(const Caller& caller, int32_t spawn_id, int32_t thing_id, int32_t sector_tag) {
  if (spawn_id <= 0) return count_things(caller, kNoType, thing_id, sector_tag);
  const std::optional<uint32_t> kind = caller.world.catalog().find_spawn_id(spawn_id);
  return kind ? count_with_replacement(caller, *kind, thing_id, sector_tag) : 0;
}

int32_t count_things_by_name(const Caller& caller, int32_t name, int32_t thing_id, int32_t sector_tag) {
  if (caller.text(name).empty()) return 0;
  const std::optional<uint32_t> kind = caller.type_named(name);
  return kind ? count_with_replacement(caller, *kind, thing_id, sector_tag) : 0;
}

int32_t classify_actor(const Caller& caller, int32_t thing_id) {
  const Actor* actor = caller.one_actor(thing_id);
  if (actor == nullptr) return thing_id == 0 ? kWorld : kNobody;
  int32_t bits = 0;
  if (const Player* player = caller.world.player_of(*actor)) {
    bits = kPlayer | (player->alive ? kAlive : kDead);
  } else if (actor->has(ActorFlag::kIsMonster)) {
    bits = kMonster | (actor->health > 0 ? kAlive : kDead);
  } else if (actor->has(ActorFlag::kMissile)) {
    bits = kMissile;
  } else {
    bits = kGeneric;
  }
  return bits;
}

int32_t unique_thing_id(World& world, int32_t first, int32_t limit) {
  const auto used = [&](int32_t thing_id) { return world.find_thing(thing_id) != nullptr; };
  constexpr int32_t kTries = 1 << 16;  // there are not as many actors
  if (first != 0) {
    const int32_t tries = limit > 0 ? std::min(limit, kTries) : kTries;
    for (int64_t thing_id = first; thing_id < int64_t{first} + tries && thing_id <= INT32_MAX; ++thing_id)
      if (thing_id != 0 && !used(static_cast<int32_t>(thing_id))) return static_cast<int32_t>(thing_id);
    return 0;
  }
  const int32_t tries = limit > 0 ? std::min(limit, kTries) : kTries;
  for (int32_t i = 0; i < tries; ++i) {
    const auto thing_id = static_cast<int32_t>(world.rng().next() >> 33);
    if (thing_id != 0 && !used(thing_id)) return thing_id;
  }
  return 0;
}

// ---------------------------------------------------------------- inventory

void give_inventory(const Caller& caller, Actor* actor, bool everyone, int32_t name, int32_t amount) {
  if (amount <= 0) return;
  std::optional<uint32_t> type;
  if (same_ignoring_case(caller.text(name), "Armor")) {
    type = caller.world.catalog().find("BasicArmorPickup");
  } else {
    type = caller.type_named(name);
  }
  if (!type) return;
  each_owner(caller, actor, everyone, [&](int player) {
    Player& owner = player_at(caller.world, player);
    const uint32_t weapon = owner.pending_weapon;
    give_item(caller.world, player, *type, amount);
    // A script changes no weapon of a hand that holds one, not even by a berserk.
    if (owner.ready_weapon != kNoType) owner.pending_weapon = weapon;
  });
}

void take_inventory(const Caller& caller, Actor* actor, bool everyone, int32_t name, int32_t amount) {
  if (amount <= 0) return;
  std::optional<uint32_t> type;
  if (is_armor(caller.text(name))) {
    type = caller.world.catalog().find("BasicArmor");
  } else {
    type = caller.type_named(name);
  }
  if (!type) return;
  each_owner(caller, actor, everyone, [&](int player) { take_item(caller.world, player, *type, amount); });
}

int32_t check_inventory(const Caller& caller, const Actor* actor, int32_t name) {
  if (actor == nullptr) return 0;
  const std::string_view text = caller.text(name);
  if (same_ignoring_case(text, "Health")) return actor->health;
  if (actor->player_index < 0 || actor->player_index >= caller.world.player_count()) return 0;
  if (is_armor(text)) return caller.world.player(actor->player_index).armor;
  const std::optional<uint32_t> type = caller.type_named(name);
  return type ? count_item(caller.world, actor->player_index, *type) : 0;
}

int32_t use_inventory(const Caller& caller, Actor* actor, bool everyone, int32_t name) {
  const std::optional<uint32_t> type = caller.type_named(name);
  if (!type) return 0;
  int32_t used = 0;
  each_owner(caller, actor, everyone,
             [&](int player) { used += use_item(caller.world, player, *type) ? 1 : 0; });
  return used;
}

void clear_inventory_of(const Caller& caller, Actor* actor, bool everyone) {
  each_owner(caller, actor, everyone, [&](int player) { clear_inventory(caller.world, player); });
}

}  // namespace comrad::doom::acs
