// Specials that act on things by their id: spawning, throwing, pushing, hurting, waking, hating.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/sight.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/specials/special_families.h"

namespace comrad::doom {
namespace {

constexpr Fixed kThrustSpeedMax = to_fixed(30);  // along each axis, unless unlimited is requested

Fixed along(int64_t length, Angle angle, bool sine) {
  return clamped_fixed((length * (sine ? fine_sine(angle) : fine_cosine(angle))) >> kFracBits);
}

// ---------------------------------------------------------------- spawning

/// Thing_Spawn and its kin: at every spot, as far as it fits.
int32_t spawn_at_spots(World& world, int32_t thing_id, Actor* activator, int32_t spawn_id, bool faces,
                       int32_t byte_angle, bool fog, int32_t new_id) {
  const std::optional<uint32_t> type = world.catalog().find_spawn_id(spawn_id);
  if (!type) return 0;
  int32_t made = 0;
  world.each_thing(thing_id, activator, [&](Actor& spot) {
    const Angle angle = faces ? spot.angle : angle_of_byte(byte_angle);
    const std::optional<uint32_t> id = spawn_actor(world, *type, spot.x, spot.y, spot.z, angle, new_id);
    if (!id) return;
    ++made;
    if (fog) spawn_fog(world, spot.x, spot.y, spot.z);
  });
  return made > 0;
}

// ---------------------------------------------------------------- missiles

struct Throw {
  int32_t spots = 0, spawn_id = 0, byte_angle = 0;
  int32_t speed = 0, vertical_speed = 0;  // eighths of a unit per tic
  int32_t target = 0;                     // thing id; 0: by the angle
  bool leads = false;                     // aims at where the target will be
  bool falls = false;
  int32_t new_id = 0;
};

/// Flies from `missile` to `target` at `speed`, ahead of it where `leads`.
void aim(Actor& missile, const Actor& target, int64_t speed, bool leads) {
  int64_t to_x = target.x, to_y = target.y, to_z = int64_t{target.z} + target.height / 2;
  speed = std::max<int64_t>(speed, 1);
  const auto tics_to = [&](int64_t x, int64_t y) {
    return std::max<int64_t>(approximate_distance(x - missile.x, y - missile.y) / speed, 1);
  };
  for (int i = 0; leads && i < 3; ++i) {
    const int64_t tics = std::min<int64_t>(tics_to(to_x, to_y), 35 * 60);
    to_x = target.x + int64_t{target.velocity_x} * tics;
    to_y = target.y + int64_t{target.velocity_y} * tics;
  }
  missile.angle = angle_to(missile.x, missile.y, clamped_fixed(to_x), clamped_fixed(to_y));
  missile.velocity_x = along(speed, missile.angle, false);
  missile.velocity_y = along(speed, missile.angle, true);
  missile.velocity_z = clamped_fixed((to_z - missile.z) / tics_to(to_x, to_y));
}

int32_t throw_from_spots(World& world, Actor* activator, const Throw& what) {
  const std::optional<uint32_t> type = world.catalog().find_spawn_id(what.spawn_id);
  if (!type) return 0;
  const int64_t speed = int64_t{clamped_units(what.speed)} / 8;
  int32_t thrown = 0;
  world.each_thing(what.spots, activator, [&](Actor& spot) {
    const auto throw_one = [&](const Actor* target) {
      Actor& missile = world.spawn_unchecked(world.catalog().replacement(*type), spot.x, spot.y, spot.z);
      missile.target_id = spot.id;
      world.set_thing_id(missile, what.new_id);
      if (what.falls) {
        missile.set(ActorFlag::kNoGravity, false);
        if (missile.gravity == 0) missile.gravity = kFracUnit;
      } else if (!missile.has(ActorFlag::kMissile)) {
        missile.set(ActorFlag::kNoGravity);
      }
      if (target != nullptr) {
        if (missile.has(ActorFlag::kSeekerMissile)) missile.tracer_id = target->id;
        aim(missile, *target, speed > 0 ? speed : missile.speed, what.leads);
      } else {
        missile.angle = angle_of_byte(what.byte_angle);
        missile.velocity_x = along(speed, missile.angle, false);
        missile.velocity_y = along(speed, missile.angle, true);
        missile.velocity_z = clamped_units(what.vertical_speed) / 8;
      }
      ++thrown;
      if (missile.has(ActorFlag::kMissile)) check_missile_spawn(world, missile, spot.radius);
    };
    if (what.target == 0) {
      throw_one(nullptr);
      return;
    }
    world.each_thing(what.target, nullptr, [&](Actor& target) {
      if (target.health > 0 && target.has(ActorFlag::kShootable)) throw_one(&target);
    });
  });
  return thrown > 0;
}

// ---------------------------------------------------------------- one thing

int32_t thrust(Actor& actor, int32_t byte_angle, int32_t force, bool unlimited) {
  const Fixed length = clamped_units(force);
  const Angle angle = angle_of_byte(byte_angle);
  actor.velocity_x = clamped_fixed(int64_t{actor.velocity_x} + along(length, angle, false));
  actor.velocity_y = clamped_fixed(int64_t{actor.velocity_y} + along(length, angle, true));
  if (!unlimited) {
    // What it flew at before counts, too: a thrust also slows down what is faster.
    actor.velocity_x = std::clamp(actor.velocity_x, -kThrustSpeedMax, kThrustSpeedMax);
    actor.velocity_y = std::clamp(actor.velocity_y, -kThrustSpeedMax, kThrustSpeedMax);
  }
  return 1;
}

void hurt_or_heal(World& world, Actor& actor, Actor* source, int32_t amount, DamageType type) {
  if (amount > 0) {
    damage_actor(world, actor, nullptr, source, amount, type);
  } else if (amount < 0) {
    heal_actor(world, actor, negated(amount));
  }
}

/// A dormant thing wakes, a lamp continues; or the other way round.
bool set_active(World& world, Actor& actor, bool active) {
  const ActorType& type = world.type_of(actor);
  const StateLabel label = active ? StateLabel::kActive : StateLabel::kInactive;
  if (actor.has(ActorFlag::kIsMonster) || actor.has(ActorFlag::kDormant)) {
    if (actor.health <= 0 || actor.has(ActorFlag::kDormant) != active) return false;
    actor.set(ActorFlag::kDormant, !active);
    actor.tics = active ? 1 : -1;
    if (type.state(label) != kNoState) set_label(world, actor, label);
    return true;
  }
  return type.state(label) != kNoState && set_label(world, actor, label);
}

/// A corpse gets up again.
bool raise_thing(World& world, Actor& actor) {
  const ActorType& type = world.type_of(actor);
  if (!actor.is_corpse() || actor.player_index >= 0 || type.state(StateLabel::kRaise) == kNoState)
    return false;
  world.unlink(actor);
  const bool was_friend = actor.has(ActorFlag::kFriendly), was_dropped = actor.has(ActorFlag::kDropped);
  actor.flags = type.flags;
  actor.set(ActorFlag::kFriendly, was_friend), actor.set(ActorFlag::kDropped, was_dropped);
  actor.radius = type.radius, actor.height = type.height;
  actor.health = type.health;
  actor.target_id = actor.last_enemy_id = 0;
  actor.velocity_x = actor.velocity_y = actor.velocity_z = 0;
  world.link(actor);
  if (actor.has(ActorFlag::kCountKill)) ++world.state().monster_count;
  set_label(world, actor, StateLabel::kRaise);
  return true;
}

/// Thing_Hate. `kind`: 0 this one until it dies; 1 and 2 all with that id; 3 and 4 also players; 5 and 6 all
/// with that id whatever players do; the even ones without having to see them.
int32_t hate(World& world, const SpecialCall& call) {
  const int32_t hated_id = call.args[1], kind = call.args[2];
  int32_t haters = 0;
  world.each_thing(call.args[0], call.activator, [&](Actor& hater) {
    if (hater.health <= 0 || !hater.has(ActorFlag::kShootable) || hater.player_index >= 0) return;
    if (world.type_of(hater).state(StateLabel::kSee) == kNoState) return;
    ++haters;
    hater.hate_thing_id = kind != 0 ? hated_id : 0;
    if (kind != 0) {
      hater.set(ActorFlag::kNoSightCheck, kind % 2 == 0);
      hater.set(ActorFlag::kHuntPlayers, kind == 3 || kind == 4);
      hater.set(ActorFlag::kNoHatePlayers, kind == 5 || kind == 6);
      // Whom it was after is forgotten, unless that is one of the hated.
      const Actor* const target = world.actor(hater.target_id);
      if (target != nullptr && target->thing_id != hated_id) hater.target_id = 0;
    }
    Actor* hated = nullptr;
    if (hated_id == 0) {
      hated = call.activator;
    } else {
      for (Actor* other = world.find_thing(hated_id); other != nullptr && hated == nullptr;
           other = world.find_thing(hated_id, other->thing_order))
        if (other->health > 0 && other->has(ActorFlag::kShootable) && !other->has(ActorFlag::kDormant))
          hated = other;
    }
    if (hated == nullptr || hated == &hater || hated->removed) return;
    const bool has_other_aim = hater.goal_id != 0 && hater.target_id == hater.goal_id;
    if (kind != 0 && has_other_aim) return;
    hater.last_enemy_id = hater.target_id;
    hater.target_id = hated->id;
    if (!hater.has(ActorFlag::kDormant)) set_label(world, hater, StateLabel::kSee);
  });
  return haters > 0;
}

/// Thing_SetGoal: thing, patrol point, wait in seconds, keeps to its way when it meets enemies.
int32_t set_goal(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  Actor* goal = a[1] != 0 ? world.find_thing(a[1]) : nullptr;
  while (goal != nullptr && !world.catalog().is_a(goal->type, "PatrolPoint"))
    goal = world.find_thing(a[1], goal->thing_order);
  int32_t any = 0;
  world.each_thing(a[0], call.activator, [&](Actor& actor) {
    if (!actor.has(ActorFlag::kShootable) || actor.player_index >= 0) return;
    any = 1;
    if (actor.goal_id != 0 && actor.target_id == actor.goal_id) actor.target_id = 0;  // its old one
    actor.goal_id = goal != nullptr ? goal->id : 0;
    actor.set(ActorFlag::kOnlyChaseGoal, a[3] != 0);
    if (goal == nullptr || actor.target_id != 0) return;
    actor.target_id = goal->id;
    if (a[2] > 0)
      actor.reaction_tics = static_cast<int32_t>(std::min<int64_t>(
          int64_t{a[2]} * 35 + static_cast<int64_t>(std::min<uint64_t>(world.tic_count(), 1u << 30)),
          INT32_MAX));
    set_label(world, actor, StateLabel::kSee);
  });
  return any;
}

/// SetPlayerProperty: everyone (0: the activator alone), value, which.
int32_t set_player_property(World& world, const SpecialCall& call) {
  enum Property : int32_t {
    kFrozen = 0,
    kNoTarget = 1,
    kInstantWeaponSwitch = 2,
    kFly = 3,
    kTotallyFrozen = 4,
    kBuddha = 16,
  };
  struct PropertyPower {
    int32_t property;
    PowerKind kind;
    int32_t tics;
  };
  static constexpr PropertyPower kPowers[] = {
      {5, PowerKind::kInvulnerable, 30 * 35},
      {6, PowerKind::kStrength, -1},
      {7, PowerKind::kInvisibility, 60 * 35},
      {8, PowerKind::kIronFeet, 60 * 35},
      {9, PowerKind::kAllMap, -1},
      {10, PowerKind::kLightAmp, 120 * 35},
      {12, PowerKind::kFlight, 60 * 35},
      {15, PowerKind::kSpeed, 45 * 35},
  };
  const bool on = call.args[1] != 0;
  const int32_t which = call.args[2];
  const auto set = [&](Player& player) {
    if (which == kFrozen) player.frozen = on;
    if (which == kNoTarget) player.no_target = on;
    if (which == kInstantWeaponSwitch) player.instant_switch = on;
    if (which == kTotallyFrozen) player.totally_frozen = on;
    if (which == kBuddha) player.buddha = on;
    if (which == kFly) {
      if (Actor* const body = world.actor(player.actor_id)) {
        body->set(ActorFlag::kFly, on);
        body->set(ActorFlag::kNoGravity, on);
      }
    }
    for (const PropertyPower& power : kPowers) {
      if (power.property != which) continue;
      std::erase_if(player.powers, [&](const Power& held) { return held.kind == power.kind; });
      if (on) player.powers.push_back({.kind = power.kind, .tics = power.tics});
    }
  };
  if (call.args[0] != 0) {
    for (Player& player : world.state().players) set(player);
    return 1;
  }
  Player* const player = call.activator != nullptr ? world.player_of(*call.activator) : nullptr;
  if (player == nullptr) return 0;
  set(*player);
  return 1;
}

int32_t change_camera(World& world, const SpecialCall& call) {
  const Actor* const camera = world.find_thing(call.args[0]);
  const uint32_t id = camera != nullptr ? camera->id : 0;
  if (call.args[0] != 0 && camera == nullptr) return 0;
  if (call.args[1] != 0 || call.activator == nullptr || call.activator->player_index < 0) {
    for (Player& player : world.state().players) player.camera_id = id;
    return 1;
  }
  world.player_of(*call.activator)->camera_id = id;
  return 1;
}

/// Thing_Destroy: things (0: everything of the tag, or every monster), gib it, tag.
int32_t destroy(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  const auto kill = [&](Actor& actor) {
    if (!actor.has(ActorFlag::kShootable) || actor.health <= 0) return;
    damage_actor(world, actor, nullptr, call.activator, a[1] != 0 ? kTelefragDamage : actor.health,
                 a[0] == 0 && a[2] == 0 ? DamageType::kMassacre : DamageType::kNormal,
                 kDamageForced | kDamageNoFactor);
  };
  if (a[0] != 0) {
    world.each_thing(a[0], nullptr, [&](Actor& actor) {
      if (a[2] == 0 || world.sectors()[actor.sector_index].tag == a[2]) kill(actor);
    });
    return 1;
  }
  const std::size_t count = world.state().actors.size();
  for (std::size_t slot = 0; slot < count; ++slot) {
    Actor& actor = world.state().actors[slot];
    if (actor.removed) continue;
    if (a[2] == 0 ? actor.has(ActorFlag::kIsMonster) : world.sectors()[actor.sector_index].tag == a[2])
      kill(actor);
  }
  return 1;
}

}  // namespace

DamageType damage_type_of(int32_t number) {
  switch (number) {
    case 12:
      return DamageType::kDrowning;
    case 13:
      return DamageType::kSlime;
    case 14:
      return DamageType::kFire;
    case 15:
      return DamageType::kCrush;
    case 16:
      return DamageType::kTelefrag;
    case 17:
      return DamageType::kFalling;
    case 18:
      return DamageType::kSuicide;
    case 20:
      return DamageType::kExit;
    case 23:
      return DamageType::kRailgun;
    case 24:
      return DamageType::kIce;
    case 26:
      return DamageType::kPoison;
    case 27:
      return DamageType::kElectric;
    case 1000:
      return DamageType::kMassacre;
    default:
      return DamageType::kNormal;
  }
}

std::optional<int32_t> execute_thing_special(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  Actor* const activator = call.activator;
  int32_t any = 0;
  switch (call.number) {
    case Special::kThing_Raise:  // things
      world.each_thing(a[0], activator, [&](Actor& actor) { any |= raise_thing(world, actor); });
      return any;
    case Special::kStartConversation:  // nobody talks
      return 0;
    case Special::kThing_Stop:  // things
      return world.each_thing(a[0], activator, [&](Actor& actor) {
        actor.velocity_x = actor.velocity_y = actor.velocity_z = 0;
        if (Player* const player = world.player_of(actor)) player->walk_x = player->walk_y = 0;
      }) > 0;
    case Special::kThrustThing:  // angle, force, unlimited, things
      return world.each_thing(a[3], activator, [&](Actor& actor) { thrust(actor, a[0], a[1], a[2] != 0); }) >
             0;
    case Special::kDamageThing:  // amount (0: dead), kind
      if (activator == nullptr) return 0;
      if (a[0] == 0) {
        damage_actor(world, *activator, nullptr, nullptr, kTelefragDamage, damage_type_of(a[1]));
      } else {
        hurt_or_heal(world, *activator, nullptr, a[0], damage_type_of(a[1]));
      }
      return 1;
    case Special::kThing_Damage:  // things, amount, kind
      return world.each_thing(a[0], activator, [&](Actor& actor) {
        if (actor.has(ActorFlag::kShootable))
          hurt_or_heal(world, actor, activator != &actor ? activator : nullptr, a[1], damage_type_of(a[2]));
      }) > 0;
    case Special::kThing_Move: {  // thing, spot, no fog
      const Actor* const spot = world.find_thing(a[1]);
      Actor* const actor = a[0] != 0 ? world.find_thing(a[0]) : activator;
      if (spot == nullptr || actor == nullptr || actor == spot) return 0;
      const Fixed old_x = actor->x, old_y = actor->y, old_z = actor->z;
      if (!put_where_it_fits(world, *actor, spot->x, spot->y, spot->z)) return 0;
      if (a[2] == 0) {
        spawn_fog(world, actor->x, actor->y, actor->z);
        spawn_fog(world, old_x, old_y, old_z);
      }
      return 1;
    }
    case Special::kThing_SetSpecial:  // things, special, three arguments
      return world.each_thing(a[0], activator, [&](Actor& actor) {
        actor.special = a[1];
        actor.args = {a[2], a[3], a[4], 0, 0};
      }) > 0;
    case Special::kThrustThingZ:  // things, speed in quarter units, down, add
      return world.each_thing(a[0], activator, [&](Actor& actor) {
        const int64_t speed = int64_t{clamped_units(a[1])} / 4 * (a[2] != 0 ? -1 : 1);
        actor.velocity_z = clamped_fixed(speed + (a[3] != 0 ? actor.velocity_z : 0));
      }) > 0;
    case Special::kThing_Activate:  // things
    case Special::kThing_Deactivate:
      world.each_thing(a[0], activator, [&](Actor& actor) {
        any |= set_active(world, actor, call.number == Special::kThing_Activate);
      });
      return any;
    case Special::kThing_Remove:  // things
      world.each_thing(a[0], activator, [&](Actor& actor) {
        if (actor.player_index >= 0) return;
        discount(world, actor);
        world.remove(actor.id);
        any = 1;
      });
      return any;
    case Special::kThing_Destroy:
      return destroy(world, call);
    case Special::kThing_Projectile:  // spots, kind, angle, speed, vertical speed
    case Special::kThing_ProjectileGravity:
      return throw_from_spots(world, activator,
                              {.spots = a[0],
                               .spawn_id = a[1],
                               .byte_angle = a[2],
                               .speed = a[3],
                               .vertical_speed = a[4],
                               .falls = call.number == Special::kThing_ProjectileGravity});
    case Special::kThing_ProjectileIntercept:  // spots, kind, speed, targets, new id
    case Special::kThing_ProjectileAimed:
      if (a[3] == 0) return 0;
      return throw_from_spots(world, activator,
                              {.spots = a[0],
                               .spawn_id = a[1],
                               .speed = a[2],
                               .target = a[3],
                               .leads = call.number == Special::kThing_ProjectileIntercept,
                               .new_id = a[4]});
    case Special::kThing_Spawn:  // spots, kind, angle, new id
    case Special::kThing_SpawnNoFog:
      return spawn_at_spots(world, a[0], activator, a[1], false, a[2], call.number == Special::kThing_Spawn,
                            a[3]);
    case Special::kThing_SpawnFacing:  // spots, kind, no fog, new id
      return spawn_at_spots(world, a[0], activator, a[1], true, 0, a[2] == 0, a[3]);
    case Special::kNoiseAlert: {  // target, emitter
      const Actor* const target = a[0] != 0 ? world.find_thing(a[0]) : activator;
      const Actor* const emitter = a[1] != 0 ? world.find_thing(a[1]) : activator;
      if (target != nullptr && emitter != nullptr) alert_monsters(world, *target, *emitter);
      return 1;
    }
    case Special::kThing_ChangeTID:  // things, new id
      return world.each_thing(a[0], activator, [&](Actor& actor) { world.set_thing_id(actor, a[1]); }) > 0;
    case Special::kThing_Hate:
      return hate(world, call);
    case Special::kThing_SetTranslation:  // things, number; only back to its own colours
      return world.each_thing(a[0], activator, [&](Actor& actor) {
        if (a[1] == 0) actor.translation = world.type_of(actor).translation;
      }) > 0;
    case Special::kSetPlayerProperty:
      return set_player_property(world, call);
    case Special::kThing_SetGoal:
      return set_goal(world, call);
    case Special::kChangeCamera:
      return change_camera(world, call);
    case Special::kHealThing: {  // amount, limit (0: its own health; 1: a soul sphere's)
      if (activator == nullptr) return 0;
      const int32_t limit = a[1] == 1 ? 200 : std::max(a[1], 0);
      heal_actor(world, *activator, a[0], activator->player_index >= 0 ? limit : 0);
      return 1;
    }
    default:
      return std::nullopt;
  }
}

}  // namespace comrad::doom
