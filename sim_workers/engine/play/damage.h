// Harm: damage, pain, death, splash, healing. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

constexpr int32_t kTelefragDamage = 1'000'000;  ///< so much or more goes through every protection

enum DamageFlag : uint32_t {
  kDamageNoArmor = 1u << 0,
  kDamageForced = 1u << 1,    ///< whatever protects
  kDamageNoFactor = 1u << 2,  ///< damage factors do not count
  kDamageThrustless = 1u << 3,
  kDamageNoSkill = 1u << 4,
};

/// Hurts `target`: skill, factors, armour, thrust away from `inflictor`, pain, infighting, death. `inflictor`
/// is what touched it (a missile, or the attacker itself), `source` who is to blame; both may be null.
/// Players do not hurt players in cooperative play. Returns the health it lost.
int32_t damage_actor(World& world, Actor& target, Actor* inflictor, Actor* source, int32_t amount,
                     DamageType type = DamageType::kNormal, uint32_t flags = 0);

/// For scripts and rules: no armour helps.
void damage_player(World& world, int player, int32_t amount);

/// The end of `target`: counts, death special, death state (XDeath, or that of the damage type), drops,
/// script events.
void kill_actor(World& world, Actor& target, Actor* inflictor, Actor* source,
                DamageType type = DamageType::kNormal);

/// Splash: everything shootable within `distance` units that `spot` sees loses damage less the distance of
/// their boxes. Without `hurts_source` neither `source` nor `spot` does.
void radius_attack(World& world, Actor& spot, Actor* source, int32_t damage, Fixed distance, DamageType type,
                   bool hurts_source = true, Fixed full_damage_distance = 0);

/// The push of a splash without its damage: `force` less the distance of the boxes, halved, for each pound; no lift.
/// `affects_source`: `spot` itself and its target, too.
void radius_thrust(World& world, const Actor& spot, int32_t force, Fixed distance, bool affects_source,
                   Fixed full_distance = 0);

/// Heals up to `limit` (0: a player's class, another actor's health when it was born). Returns what was gained.
int32_t heal_actor(World& world, Actor& actor, int32_t amount, int32_t limit = 0);

/// Runs the special of an actor that died or was picked up; clears it.
void run_actor_special(World& world, Actor& actor, Actor* activator);

}  // namespace comrad::doom
