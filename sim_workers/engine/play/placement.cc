#include "sim_workers/engine/play/placement.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <optional>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/movement.h"

namespace comrad::doom {

bool try_teleport(World& world, uint32_t actor_id, Fixed x, Fixed y) {
  const std::optional<std::size_t> slot = world.find_slot(actor_id);
  if (!slot || !world.index().outline.contains(x, y))
    return false;  // no line is touched deep inside a pillar
  Movement movement(world);
  const PositionCheck check = movement.check_position(*slot, x, y, false);
  Actor& actor = world.state().actors[*slot];
  if (!check.fits || int64_t{check.ceiling_z} - check.floor_z < actor.height) return false;
  const bool on_ground = actor.z <= actor.floor_z;
  const Fixed z = on_ground ? check.floor_z : std::max(actor.z, check.floor_z);
  if (int64_t{z} + actor.height > check.ceiling_z) return false;
  movement.place(*slot, x, y, check);
  actor.z = z;
  return true;
}

void set_position(World& world, uint32_t actor_id, Fixed x, Fixed y, Fixed z) {
  const std::optional<std::size_t> slot = world.find_slot(actor_id);
  if (!slot) return;
  Movement(world).place(*slot, x, y, opening_of_point(world, x, y));
  world.state().actors[*slot].z = z;
}

bool put_where_it_fits(World& world, Actor& actor, Fixed x, Fixed y, Fixed z) {
  const Fixed old_x = actor.x, old_y = actor.y, old_z = actor.z;
  set_position(world, actor.id, x, y, z);
  if (fits_here(world, actor)) return true;
  set_position(world, actor.id, old_x, old_y, old_z);
  return false;
}

bool teleport_move(World& world, Actor& actor, Fixed x, Fixed y, Fixed z, Angle angle, bool fog,
                   bool keep_velocity, bool telefrag) {
  if (actor.removed) return false;
  WorldState& state = world.state();
  Movement movement(world);
  const std::size_t slot = world.slot_of(actor);
  const uint32_t sector_index = world.sector_at(x, y);
  const Sector& sector = world.sectors()[sector_index];
  const Fixed bottom = z == kOnFloor ? sector.floor_height : z;
  const std::size_t count = state.actors.size();
  for (std::size_t i = 0; i < count; ++i) {
    Actor& other = state.actors[i];
    if (i == slot || other.removed || !other.has(ActorFlag::kShootable) || other.has(ActorFlag::kNoBlockmap))
      continue;
    const int64_t reach = int64_t{actor.radius} + other.radius;
    if (std::abs(int64_t{other.x} - x) >= reach || std::abs(int64_t{other.y} - y) >= reach) continue;
    if (bottom >= int64_t{other.z} + other.height || int64_t{bottom} + actor.height <= other.z) continue;
    if (!telefrag) return false;
    damage_actor(world, other, &actor, &actor, kTelefragDamage, DamageType::kTelefrag,
                 kDamageForced | kDamageThrustless);
    if (actor.removed) return false;
  }
  const Fixed from_x = actor.x, from_y = actor.y, from_z = actor.z;
  PositionCheck check = movement.check_position(slot, x, y, false);
  if (!check.fits) check = opening_of_point(world, x, y);  // against a wall or a pillar
  movement.place(slot, x, y, check);
  const int64_t highest = std::max<int64_t>(int64_t{check.ceiling_z} - actor.height, check.floor_z);
  actor.z =
      z == kOnFloor ? check.floor_z : static_cast<Fixed>(std::clamp<int64_t>(z, check.floor_z, highest));
  actor.angle = angle;
  if (!keep_velocity) actor.velocity_x = actor.velocity_y = actor.velocity_z = 0;
  if (Player* const player = world.player_of(actor))
    player->view_z = clamped_fixed(int64_t{actor.z} + player->view_height);
  if (fog) {
    spawn_fog(world, from_x, from_y, from_z);
    spawn_fog(world, clamped_fixed(int64_t{x} + int64_t{kFogAhead} * fine_cosine(angle)),
              clamped_fixed(int64_t{y} + int64_t{kFogAhead} * fine_sine(angle)), actor.z);
  }
  return true;
}

void spawn_fog(World& world, Fixed x, Fixed y, Fixed z) {
  if (const uint32_t fog = world.catalog().known().teleport_fog; fog != kNoType)
    world.spawn_unchecked(fog, x, y, z);
}

}  // namespace comrad::doom
