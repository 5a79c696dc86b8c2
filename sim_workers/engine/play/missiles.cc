#include "sim_workers/engine/play/missiles.h"

#include <algorithm>
#include <cmath>

#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/movement.h"

namespace comrad::doom {
namespace {

constexpr Fixed kMissileHeight = to_fixed(32);  // above the feet of its shooter

/// Length of a vector in map units of 1/256: squares stay below 2^53, so the root is the same on
/// every machine.
int64_t length_of(int64_t x, int64_t y, int64_t z) {
  const auto squared = [](int64_t value) {
    return static_cast<double>(value >> 8) * static_cast<double>(value >> 8);
  };
  return static_cast<int64_t>(std::sqrt(squared(x) + squared(y) + squared(z))) << 8;
}

}  // namespace

int32_t roll_damage(World& world, const DamageDice& dice) {
  if (dice.exact || dice.factor == 0) return dice.factor;
  return clamped_fixed(int64_t{dice.factor} * (1 + world.random_byte() % 8));
}

void explode_missile(World& world, Actor& missile, Actor* struck) {
  if (missile.removed) return;
  missile.velocity_x = missile.velocity_y = missile.velocity_z = 0;
  // What it struck was hurt when the move found it (movement.cc); a missile that dies in the air
  // hurts nobody.
  const ActorType& type = world.type_of(missile);
  uint32_t next = type.state(StateLabel::kDeath);
  if (struck != nullptr && !struck->has(ActorFlag::kNoBlood) && type.state(StateLabel::kXDeath) != kNoState) {
    next = type.state(StateLabel::kXDeath);
  } else if (struck != nullptr && type.state(StateLabel::kCrash) != kNoState) {
    next = type.state(StateLabel::kCrash);
  }
  missile.set(ActorFlag::kMissile, false);
  missile.special_1 = struck != nullptr ? static_cast<int32_t>(struck->id) : 0;
  if (next == kNoState) {
    world.remove(missile.id);
    return;
  }
  const bool randomized = missile.has(ActorFlag::kRandomize);
  if (set_state(world, missile, next) && randomized && missile.tics > 1)
    missile.tics = std::max(1, missile.tics - (world.random_byte() & 3));
}

bool check_missile_spawn(World& world, Actor& missile, Fixed reach) {
  if (missile.has(ActorFlag::kRandomize) && missile.tics > 1)
    missile.tics = std::max(1, missile.tics - (world.random_byte() & 3));
  // Ahead of its shooter, but within the shooter's radius: half a step, or half of that, and so on.
  const int64_t speed = length_of(missile.velocity_x, missile.velocity_y, 0);
  int32_t parts = 2;
  while (speed / parts >= std::max(reach, kFracUnit) && parts < kFracUnit) parts *= 2;
  const uint32_t id = missile.id;
  missile.z = clamped_fixed(int64_t{missile.z} + missile.velocity_z / parts);
  Movement movement(world);
  const std::size_t slot = world.slot_of(missile);
  const Fixed x = clamped_fixed(int64_t{missile.x} + missile.velocity_x / parts);
  const Fixed y = clamped_fixed(int64_t{missile.y} + missile.velocity_y / parts);
  // It strikes from there and ends there, also where that is inside of what stopped it (measured: the push of a rocket fired into a
  // near wall).
  movement.place(slot, x, y, opening_of_point(world, x, y));
  if (movement.try_move(slot, x, y)) return !missile.removed;
  if (world.actor(id) == nullptr) return false;
  if (missile.has(ActorFlag::kMissile)) movement.stop_missile(slot);
  return false;
}

Actor* spawn_missile_z(World& world, Actor& source, Fixed z, Actor& target, uint32_t type) {
  if (type == kNoType) return nullptr;
  Actor& missile = world.spawn_unchecked(type, source.x, source.y, z);
  missile.target_id = source.id;
  const int64_t dx = int64_t{target.x} - source.x, dy = int64_t{target.y} - source.y;
  int64_t dz = int64_t{target.z} - source.z;
  // Over the head of a low target it aims down at it.
  if (z >= int64_t{target.z} + target.height) dz += int64_t{target.height} - (int64_t{z} - source.z);
  const int64_t length = std::max<int64_t>(length_of(dx, dy, dz), kFracUnit);
  Angle angle = angle_to(source.x, source.y, target.x, target.y);
  if (target.has(ActorFlag::kShadow)) angle += static_cast<Angle>(world.random_triangle()) << 20;
  const int64_t across = length_of(dx, dy, 0);
  const auto flat_speed = clamped_fixed(missile.speed * across / length);
  missile.angle = angle;
  missile.velocity_x = fixed_mul(flat_speed, fine_cosine(angle));
  missile.velocity_y = fixed_mul(flat_speed, fine_sine(angle));
  missile.velocity_z = clamped_fixed(missile.speed * dz / length);
  return check_missile_spawn(world, missile, source.radius) ? &missile : nullptr;
}

Actor* spawn_missile(World& world, Actor& source, Actor& target, uint32_t type) {
  return spawn_missile_z(world, source, clamped_fixed(int64_t{source.z} + kMissileHeight), target, type);
}

Actor* spawn_player_missile(World& world, Actor& body, uint32_t type, Angle angle, Fixed x_offset,
                            Fixed y_offset, Fixed z_offset) {
  if (type == kNoType) return nullptr;
  constexpr Fixed kMissileAimRange = to_fixed(16 * 64);
  constexpr Angle kAimStep = 1u << 26;  // 5.6 degrees
  // A player that looks freely without auto-aim hits what it points at. For all others a missile turns to
  // where the target was found, without auto-aim as well (measured).
  const bool exact = world.options().free_look && !world.options().autoaim;
  Aim aim = aim_line(world, body, angle, kMissileAimRange);
  if (aim.target == nullptr && !exact) {
    for (const Angle turned : {angle + kAimStep, angle - kAimStep}) {
      const Aim beside = aim_line(world, body, turned, kMissileAimRange);
      if (beside.target == nullptr) continue;
      aim = beside;
      angle = turned;
      break;
    }
  }
  const Fixed x = clamped_fixed(int64_t{body.x} + x_offset), y = clamped_fixed(int64_t{body.y} + y_offset);
  // Four units below the height of attacks, which crouching lowers (measured).
  const Player* player = world.player_of(body);
  const Fixed hands = player == nullptr
                          ? to_fixed(4)
                          : fixed_mul(player->attack_z_offset - to_fixed(4), player->crouch_factor);
  const Fixed z = clamped_fixed(int64_t{body.z} + body.height / 2 + hands + z_offset);
  Actor& missile = world.spawn_unchecked(type, x, y, z, angle);
  missile.target_id = body.id;
  // The sines of the table are a little short of a direction; the speed is whole.
  const Angle pitch = missile.has(ActorFlag::kFloorHugger) ? 0u : static_cast<Angle>(aim.pitch);
  const int64_t way_x = fixed_mul(fine_cosine(pitch), fine_cosine(angle));
  const int64_t way_y = fixed_mul(fine_cosine(pitch), fine_sine(angle)), way_z = -fine_sine(pitch);
  const double length = std::sqrt(static_cast<double>(way_x * way_x + way_y * way_y + way_z * way_z));
  const auto part = [&](int64_t way) {
    return static_cast<Fixed>(static_cast<double>(missile.speed * way) / length);
  };
  missile.velocity_x = part(way_x), missile.velocity_y = part(way_y), missile.velocity_z = part(way_z);
  return check_missile_spawn(world, missile, body.radius) ? &missile : nullptr;
}

}  // namespace comrad::doom
