// What the action functions of monsters share: types by name, missiles with offsets, bullets, blows. Stage:
// tic.
#pragma once

#include <cstdint>
#include <string_view>

#include "sim_workers/engine/play/actions.h"

namespace comrad::doom {

constexpr Fixed kMissileRange = to_fixed(2048);  ///< of monsters' bullets
constexpr Fixed kBlowRange = to_fixed(64);

/// What is spawned under that name; kNoType where the catalog has none.
uint32_t type_named(const World& world, std::string_view name);
/// Rolls (1..sides) * factor.
int32_t roll(World& world, int32_t sides, int32_t factor);
/// Degrees in 16.16 as an angle.
Angle angle_of_degrees(Fixed degrees);

/// Faces the target; null where there is none.
Actor* face_and_get_target(ActionCall& call);
/// Bullets in the direction that the monster faces, with Doom's spread: 3, 6 .. 15 damage each.
void fire_bullets(World& world, Actor& monster, int count, uint32_t puff_type = kNoType);
/// A missile of that kind at the target.
Actor* shoot(ActionCall& call, Actor& target, uint32_t type);
/// A blow where the target is in reach, else a missile.
void claw_or_shoot(ActionCall& call, int32_t sides, int32_t factor, std::string_view missile);
/// Turns a missile that is on its way.
void redirect(Actor& missile, Angle angle, Fixed flat_speed);
/// Renews its place in the lists after its flags changed.
void relink(World& world, Actor& actor);
/// An arch-vile lets a corpse on its way rise. False where there is none.
bool vile_raises(World& world, Actor& vile);

}  // namespace comrad::doom
