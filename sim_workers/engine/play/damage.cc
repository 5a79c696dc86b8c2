#include "sim_workers/engine/play/damage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/sight.h"
#include "sim_workers/engine/play/weapons.h"

namespace comrad::doom {
namespace {

constexpr int32_t kDamageFlashMax = 100;
constexpr int32_t kCountedDamage = 1000;  // ViZDoom counts no greater one: neither hit nor points
constexpr int32_t kHoldTargetTics = 100;  // a monster keeps who hurt it last for so long
constexpr Fixed kThrustMax = to_fixed(200);
constexpr int32_t kBlastPushMax = 10'000;  // points of damage
constexpr int kBlastBits = 14;             // of a blast's push, beyond Fixed's
constexpr int64_t kBlastPoint = int64_t{kFracUnit} << kBlastBits;

Fixed scale(Fixed factor, int32_t amount) {
  return static_cast<Fixed>(
      std::clamp<int64_t>((int64_t{amount} * factor) >> kFracBits, INT32_MIN, INT32_MAX));
}

int32_t add_saturated(int32_t total, int32_t amount) {
  return static_cast<int32_t>(std::clamp<int64_t>(int64_t{total} + amount, INT32_MIN, INT32_MAX));
}

/// By Doom's table of slopes (measured: 94 of 94 blasts from places drawn by chance).
Angle way_of_push(const Actor& from, const Actor& target) {
  return vector_angle(clamped_fixed(int64_t{target.x} - from.x), clamped_fixed(int64_t{target.y} - from.y));
}

/// Pushes the target away from what hit it, harder the lighter it is.
void thrust_away(World& world, Actor& target, const Actor& inflictor, int32_t amount, int32_t kickback) {
  if (target.mass <= 0 || target.has(ActorFlag::kNoClip) || target.has(ActorFlag::kDontThrust) ||
      inflictor.has(ActorFlag::kNoDamageThrust))
    return;
  Angle angle = way_of_push(inflictor, target);
  int64_t thrust = int64_t{amount} * (kFracUnit >> 3) * kickback / target.mass;
  // A light hit from far below may make the dying fall towards it.
  if (amount < 40 && amount > target.health && int64_t{target.z} - inflictor.z > to_fixed(64) &&
      (world.random_byte() & 1) != 0) {
    angle += kAngle180;
    thrust *= 4;
  }
  const auto force = static_cast<Fixed>(std::clamp<int64_t>(thrust, 0, kThrustMax));
  target.push(angle, force);
}

/// Half a unit a tic for each point of a blast and pound; `points` and the result have kBlastBits more bits than Fixed.
int64_t blast_thrust(int64_t points, const Actor& target) {
  constexpr int64_t kMost = int64_t{kThrustMax} << kBlastBits;
  return std::clamp(points / 2 / target.mass, -kMost, kMost);
}

/// Away from `spot`; cut towards 0, as in ViZDoom.
void push_by_blast(Actor& target, const Actor& spot, int64_t thrust) {
  const Angle way = way_of_push(spot, target);
  const auto part = [&](Fixed share) {
    return static_cast<int64_t>(static_cast<__int128>(thrust) * share / (int64_t{kFracUnit} << kBlastBits));
  };
  target.velocity_x = clamped_fixed(target.velocity_x + part(fine_cosine(way)));
  target.velocity_y = clamped_fixed(target.velocity_y + part(fine_sine(way)));
}

/// What a blast adds to the damage's own push: half a unit a tic for each of its points (16.16, before rounding)
/// and pound, and as much up for each unit by which the middle of the body lies above it, times 0.8 for its own source and 0.5
/// for others. Measured in ViZDoom 1.3.2: 13.0033 across and -1.6107 up 33 units from a rocket of one's own.
void lift(Actor& target, const Actor& spot, const Actor* source, int64_t points) {
  constexpr int64_t kOfOneself = 8, kOfOthers = 5;  // tenths
  if (target.mass <= 0 || target.has(ActorFlag::kNoClip) || target.has(ActorFlag::kDontThrust) ||
      spot.has(ActorFlag::kNoDamageThrust) || spot.has(ActorFlag::kOldRadiusDamage) ||
      target.has(ActorFlag::kOldRadiusDamage))
    return;
  const int64_t thrust = blast_thrust(points, target);
  push_by_blast(target, spot, thrust);
  const int64_t above = int64_t{target.z} + target.height / 2 - spot.z;
  const auto up = static_cast<int64_t>(static_cast<__int128>(thrust) * above *
                                       (&target == source ? kOfOneself : kOfOthers) /
                                       (int64_t{10} << (kFracBits + kBlastBits)));
  target.velocity_z =
      clamped_fixed(int64_t{target.velocity_z} + std::clamp<int64_t>(up, -kThrustMax, kThrustMax));
}

/// Those that a blast may reach.
struct Victims {
  std::array<uint32_t, 256> ids;
  std::size_t count = 0;
};

Victims shootable_near(const World& world, const Actor& spot, Fixed distance) {
  const WorldState& state = world.state();
  const Blockmap& blockmap = world.index().blockmap;
  const Box reach = Box::around(
      spot.x, spot.y,
      static_cast<Fixed>(std::min<int64_t>(int64_t{distance} + state.radius_max, to_fixed(32000))));
  Victims found;
  for (int row = blockmap.row_of(reach.bottom); row <= blockmap.row_of(reach.top); ++row) {
    for (int column = blockmap.column_of(reach.left); column <= blockmap.column_of(reach.right); ++column) {
      for (int32_t slot = state.cell_heads[static_cast<std::size_t>(row) * blockmap.columns() + column];
           slot >= 0; slot = state.links[static_cast<std::size_t>(slot)].next) {
        const Actor& actor = state.actors[static_cast<std::size_t>(slot)];
        if (actor.has(ActorFlag::kShootable) && found.count < found.ids.size())
          found.ids[found.count++] = actor.id;
      }
    }
  }
  return found;
}

/// Distance of the point from the victim's box, its height included.
int64_t blast_length(const Actor& victim, const Actor& spot) {
  const int64_t across =
      std::max({std::abs(int64_t{victim.x} - spot.x), std::abs(int64_t{victim.y} - spot.y)}) - victim.radius;
  const int64_t length = std::max<int64_t>(across, 0);
  const int64_t below = int64_t{victim.z} - spot.z,
                above = int64_t{spot.z} - (int64_t{victim.z} + victim.height);
  const int64_t rise = std::max<int64_t>({below, above, 0});
  if (rise <= 0) return length;
  const double squared = static_cast<double>(length) * static_cast<double>(length) +
                         static_cast<double>(rise) * static_cast<double>(rise);
  return static_cast<int64_t>(std::sqrt(squared));  // correctly rounded: the same everywhere
}

/// Whole up to `full`, from there on linear to nothing at `distance`.
int64_t weakened(int64_t whole, int64_t length, Fixed distance, Fixed full) {
  full = std::clamp<Fixed>(full, 0, distance - 1);
  return length > full
             ? static_cast<int64_t>(static_cast<__int128>(whole) * (distance - length) / (distance - full))
             : whole;
}

/// The monster turns on who hurt it, unless it holds on to somebody else.
void take_revenge(World& world, Actor& target, Actor* source) {
  if (source == nullptr || source == &target || source->has(ActorFlag::kNeverTarget)) return;
  const bool free_to_turn = target.threshold == 0 || target.has(ActorFlag::kQuickToRetaliate);
  if (!free_to_turn || target.has(ActorFlag::kNoTargetSwitch) || target.has(ActorFlag::kNoTarget)) return;
  // An actor marked so is forgiven by other monsters (the arch-vile).
  if (source->player_index < 0 && source->has(ActorFlag::kNoTarget)) return;
  if (target.has(ActorFlag::kNoInfighting) && source->has(ActorFlag::kIsMonster)) return;
  target.last_enemy_id = target.target_id;
  target.target_id = source->id;
  target.threshold = kHoldTargetTics;
  const ActorType& type = world.type_of(target);
  const uint32_t spawn = type.state(StateLabel::kSpawn);
  const bool idles =
      spawn != kNoState && (target.state == spawn || target.state == world.catalog().state(spawn).next);
  if (idles && type.state(StateLabel::kSee) != kNoState) set_label(world, target, StateLabel::kSee);
}

/// The state that a type has for one kind of damage ("Death.Fire"; the prefix has the point, in lower case);
/// kNoState where there is none.
uint32_t state_for_damage(const World& world, const ActorType& type, std::string_view prefix,
                          DamageType kind) {
  if (kind == DamageType::kNormal || type.labels.empty()) return kNoState;
  const std::string_view name = world.catalog().damage_type_name(kind);
  for (const ActorType::Label& label : type.labels)  // whose names are in lower case
    if (label.name.starts_with(prefix) &&
        same_ignoring_case(std::string_view(label.name).substr(prefix.size()), name))
      return label.state;
  return kNoState;
}

}  // namespace

int32_t damage_actor(World& world, Actor& target, Actor* inflictor, Actor* source, int32_t amount,
                     DamageType type, uint32_t flags) {
  if (amount <= 0 || target.removed || target.health <= 0 || !target.has(ActorFlag::kShootable)) return 0;
  if (target.has(ActorFlag::kDormant)) return 0;
  const bool forced = (flags & kDamageForced) != 0 || amount >= kTelefragDamage;
  if (!forced && target.has(ActorFlag::kInvulnerable)) return 0;
  if (target.has(ActorFlag::kSkullFly)) target.velocity_x = target.velocity_y = target.velocity_z = 0;

  Player* player = world.player_of(target);
  const Player* attacker = source != nullptr ? world.player_of(*source) : nullptr;
  if (!forced) {
    if (player != nullptr && world.options().skill <= 1 && (flags & kDamageNoSkill) == 0)
      amount = std::max(amount / 2, 1);
    if ((flags & kDamageNoFactor) == 0) {
      const ActorType& target_type = world.type_of(target);
      amount = scale(target_type.damage_factor[static_cast<std::size_t>(type)], amount);
      amount = scale(target.damage_factor, amount);
      if (attacker != nullptr && attacker->has_power(PowerKind::kDoubleDamage))
        amount = add_saturated(amount, amount);
      if (player != nullptr && player->has_power(PowerKind::kProtection)) amount /= 4;
      if (amount <= 0) return 0;
    }
    if (player != nullptr && (player->god_mode || player->has_power(PowerKind::kInvulnerable))) return 0;
  }

  if (inflictor != nullptr && (flags & kDamageThrustless) == 0 && type != DamageType::kPoison) {
    const int32_t kickback = attacker != nullptr && attacker->ready_weapon != kNoType
                                 ? world.catalog()[attacker->ready_weapon].weapon.kickback
                                 : 100;
    thrust_away(world, target, *inflictor, std::min(amount, 10'000), kickback);
  }
  // Friends in a cooperative game push each other, but do not hurt: neither health nor any count changes.
  if (!forced && player != nullptr && attacker != nullptr && source != &target && !world.options().deathmatch)
    return 0;

  if (player != nullptr) {
    if ((flags & (kDamageNoArmor | kDamageForced)) == 0)
      amount = absorb_damage(world, target.player_index, amount, type);
    if (amount <= kCountedDamage) {
      player->damage_taken = add_saturated(player->damage_taken, amount);
      ++player->hits_taken;
    }
    if (source != nullptr) player->attacker_id = source->id;
    player->damage_flash =
        static_cast<int32_t>(std::min<int64_t>(int64_t{player->damage_flash} + amount, kDamageFlashMax));
    if (amount <= 0) return 0;
  }
  const bool harmless = target.has(ActorFlag::kNoDamage);  // it feels pain all the same
  if (attacker != nullptr && source != &target && amount <= kCountedDamage && !harmless) {
    Player& shooter = world.state().players[static_cast<std::size_t>(source->player_index)];
    ++shooter.hits_dealt;
    // Whole, however little health was left: ViZDoom counts it so (basic.wad: 10 or 15 for a target with 1).
    shooter.damage_dealt = add_saturated(shooter.damage_dealt, amount);
  }

  const int32_t health_before = target.health;
  if (!harmless) target.health = add_saturated(target.health, -amount);
  if ((target.has(ActorFlag::kBuddha) || (player != nullptr && player->buddha)) && !forced)
    target.health = std::max(target.health, 1);
  if (player != nullptr) player->health = std::max(target.health, 0);
  if (target.health <= 0) {
    kill_actor(world, target, inflictor, source, type);
    return health_before;
  }

  const ActorType& target_type = world.type_of(target);
  const bool feels = !target.has(ActorFlag::kNoPain) && !target.has(ActorFlag::kSkullFly) &&
                     amount >= target_type.pain_threshold &&
                     !(inflictor != nullptr && inflictor->has(ActorFlag::kPainless));
  const uint32_t id = target.id;
  int32_t chance = target_type.pain_chance;
  for (const auto& [kind, own_chance] : target_type.pain_chances)
    if (kind == type) chance = own_chance;
  if (feels && world.random_byte() < chance) {
    target.set(ActorFlag::kJustHit);  // strikes back
    if (const uint32_t own = state_for_damage(world, target_type, "pain.", type); own != kNoState) {
      set_state(world, target, own);
    } else {
      set_label(world, target, StateLabel::kPain);
    }
  }
  if (world.actor(id) == nullptr) return amount;
  target.reaction_tics = 0;  // awake now
  if (player == nullptr) take_revenge(world, target, source);
  return std::min(amount, health_before);
}

void kill_actor(World& world, Actor& target, Actor* inflictor, Actor* source, DamageType damage_type) {
  WorldState& state = world.state();
  const ActorType& type = world.type_of(target);
  Player* player = world.player_of(target);
  target.set(ActorFlag::kShootable, false);
  target.set(ActorFlag::kFloat, false);
  target.set(ActorFlag::kSkullFly, false);
  target.set(ActorFlag::kKilled);
  target.set(ActorFlag::kCorpse);
  target.set(ActorFlag::kDropOff);
  if (!target.has(ActorFlag::kDontFall)) target.set(ActorFlag::kNoGravity, false);
  world.unlink(target);
  target.height = type.death_height >= 0 ? type.death_height : target.height / 4;
  if (!target.has(ActorFlag::kIceCorpse))
    world.link(target);  // a monster blocks until its fall (A_NoBlocking)

  if (target.has(ActorFlag::kCountKill) && !target.has(ActorFlag::kFriendly)) ++state.kill_total;
  if (source != nullptr) target.target_id = source->id;  // whom a script finds behind the death
  // The dead one's special is the killer's deed.
  if (target.special != 0 && (!target.has(ActorFlag::kSpecial) || target.has(ActorFlag::kIsMonster)))
    run_actor_special(world, target, source);

  if (player != nullptr) {
    player->health = 0;
    player->alive = false;
    player->state = PlayerState::kDead;
    player->death_tic = state.tic_count;
    ++player->death_count;
    player->respawn_tics = std::max(world.options().respawn_delay_tics, 0);
    if (source != nullptr && source->player_index >= 0 && source != &target) {
      ++state.players[static_cast<std::size_t>(source->player_index)].frag_count;
    } else {
      --player->frag_count;  // its own deed, or that of the map
    }
    target.set(ActorFlag::kSolid, false);
    world.unlink(target);
    if (world.has(wad::GameFlag::kDropWeapons) && (world.is_multiplayer() || world.options().deathmatch))
      drop_item(world, target, player->ready_weapon, -1, 255);
    drop_weapon(world, target.player_index);
  } else if (target.has(ActorFlag::kIsMonster)) {
    state.corpse_ids.push_back(target.id);
  }

  const int64_t gib_below = type.gib_health != INT32_MIN ? type.gib_health : -int64_t{type.health};
  const bool extreme =
      (target.health < gib_below || (inflictor != nullptr && inflictor->has(ActorFlag::kExtremeDeath))) &&
      !(inflictor != nullptr && inflictor->has(ActorFlag::kNoExtremeDeath));
  const uint32_t id = target.id;
  const int player_index = target.player_index;
  const uint32_t death = type.state(StateLabel::kDeath), torn = type.state(StateLabel::kXDeath);
  uint32_t next = extreme && torn != kNoState ? torn : death;
  if (const uint32_t own = state_for_damage(world, type, "death.", damage_type); own != kNoState) next = own;
  if (next != kNoState || player == nullptr) {
    if (set_state(world, target, next) && target.tics > 1)
      target.tics = std::max(1, target.tics - (world.random_byte() & 3));
  }
  if (player_index >= 0) {
    world.events().player_died(world, player_index, id);
  }
}

void radius_attack(World& world, Actor& spot, Actor* source, int32_t damage, Fixed distance, DamageType type,
                   bool hurts_source, Fixed full_damage_distance) {
  if (distance <= 0 || damage <= 0) return;
  const Victims victims = shootable_near(world, spot, distance);
  const uint32_t spot_id = spot.id;
  for (std::size_t i = 0; i < victims.count; ++i) {
    Actor* victim = world.actor(victims.ids[i]);
    if (victim == nullptr || !victim->has(ActorFlag::kShootable)) continue;
    if (victim->has(ActorFlag::kNoRadiusDamage) && !spot.has(ActorFlag::kForceRadiusDamage)) continue;
    if (!hurts_source && (victim->id == spot_id || (source != nullptr && victim->id == source->id))) continue;
    const int64_t length = blast_length(*victim, spot);
    if (length >= distance || !can_see(world, *victim, spot)) continue;
    const auto points = static_cast<int32_t>(weakened(damage, length, distance, full_damage_distance));
    const int64_t push = weakened(int64_t{std::min(damage, kBlastPushMax)} * kBlastPoint, length, distance,
                                  full_damage_distance);
    const uint32_t victim_id = victim->id;
    if (points > 0) damage_actor(world, *victim, &spot, source, points, type);
    victim = world.actor(victim_id);
    if (victim != nullptr) lift(*victim, spot, source, push);
  }
}

void radius_thrust(World& world, const Actor& spot, int32_t force, Fixed distance, bool affects_source,
                   Fixed full_distance) {
  if (distance <= 0) return;
  const Victims victims = shootable_near(world, spot, distance);
  for (std::size_t i = 0; i < victims.count; ++i) {
    Actor* victim = world.actor(victims.ids[i]);
    if (victim == nullptr || victim->mass <= 0 || victim->has(ActorFlag::kDontThrust)) continue;
    if (victim->has(ActorFlag::kNoRadiusDamage) && !spot.has(ActorFlag::kForceRadiusDamage)) continue;
    if (!affects_source && (victim->id == spot.id || victim->id == spot.target_id)) continue;
    const int64_t length = blast_length(*victim, spot);
    if (length >= distance || !can_see(world, *victim, spot)) continue;
    const int64_t points = weakened(int64_t{std::clamp(force, -kBlastPushMax, kBlastPushMax)} * kBlastPoint,
                                    length, distance, full_distance);
    push_by_blast(*victim, spot, blast_thrust(points, *victim));
  }
}

void damage_player(World& world, int player_index, int32_t amount) {
  if (player_index < 0 || player_index >= world.player_count() || amount <= 0) return;
  if (Actor* body = world.body_of(player_index))
    damage_actor(world, *body, nullptr, nullptr, std::min(amount, 1'000'000), DamageType::kNormal,
                 kDamageNoArmor);
}

int32_t heal_actor(World& world, Actor& actor, int32_t amount, int32_t limit) {
  if (actor.health <= 0 || amount <= 0) return 0;
  Player* player = world.player_of(actor);
  const int32_t most = limit > 0           ? limit
                       : player != nullptr ? world.type_of(actor).health
                                           : actor.start_health;
  if (actor.health >= most) return 0;
  const int32_t gained = std::min(amount, most - actor.health);
  actor.health += gained;
  if (player != nullptr) player->health = actor.health;
  return gained;
}

void run_actor_special(World& world, Actor& actor, Actor* activator) {
  if (actor.special == 0) return;
  const SpecialCall call{.number = actor.special, .args = actor.args, .activator = activator};
  actor.special = 0;
  world.events().run_special(world, call);
}

}  // namespace comrad::doom
