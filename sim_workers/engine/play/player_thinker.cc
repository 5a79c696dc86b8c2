#include "sim_workers/engine/play/player_thinker.h"

#include <algorithm>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/weapons.h"
#include "sim_workers/engine/specials/line_specials.h"

namespace comrad::doom {
namespace {

// Turning, in 65536ths of a turn per tic. The slow start lasts kSlowTurnTics, whatever the direction.
constexpr int32_t kTurnSlow = 320, kTurnWalk = 640, kTurnRun = 1280;
constexpr int kSlowTurnTics = 5;
// Pushes, in 1/32 unit per tic^2.
constexpr int32_t kForwardWalk = 25, kForwardRun = 50, kSideWalk = 24, kSideRun = 40;
constexpr Fixed kPushUnit = kFracUnit / 32;
constexpr int kTurnAroundTics = 9;
constexpr int64_t kPitchUpMax = -(int64_t{32} << 32) / 360, kPitchDownMax = (int64_t{56} << 32) / 360;
// The eye.
constexpr Fixed kBobMax = to_fixed(16);
constexpr Fixed kBobFactor = kFracUnit / 4;
constexpr uint64_t kBobTics = 20;
constexpr Fixed kEyeHeightDead = to_fixed(6);
constexpr Fixed kEyeRise = kFracUnit / 4;

}  // namespace

bool PlayerThinker::pushes(const Buttons& buttons) {
  return forward_units(buttons) != 0 || side_units(buttons) != 0;
}

bool PlayerThinker::is_walking(const World& world, const Actor& body) {
  const uint32_t first = world.type_of(body).state(StateLabel::kSee);
  return first != kNoState && body.state >= first && body.state < first + 4;
}

int32_t PlayerThinker::forward_units(const Buttons& buttons) {
  const int32_t keys =
      (int32_t{buttons.forward} - int32_t{buttons.backward}) * (buttons.speed ? kForwardRun : kForwardWalk);
  return std::clamp(keys + buttons.forward_delta, -kForwardRun, kForwardRun);
}

int32_t PlayerThinker::side_units(const Buttons& buttons) {
  const bool strafing_right = buttons.right || (buttons.strafe && buttons.turn_right);
  const bool strafing_left = buttons.left || (buttons.strafe && buttons.turn_left);
  const int32_t keys = (int32_t{strafing_right} - int32_t{strafing_left}) * (buttons.speed ? kSideRun : kSideWalk);
  return std::clamp(keys + buttons.side_delta, -kForwardRun, kForwardRun);
}

void PlayerThinker::turn(Player& player, Actor& body, const Buttons& buttons) {
  // The counter goes on while any turn is held, also across a change of direction.
  player.turn_held_tics = buttons.turn_left || buttons.turn_right ? player.turn_held_tics + 1 : 0;
  const int32_t speed = player.turn_held_tics <= kSlowTurnTics ? kTurnSlow
                        : buttons.speed                        ? kTurnRun
                                                               : kTurnWalk;
  const int32_t direction = buttons.strafe ? 0 : int32_t{buttons.turn_left} - int32_t{buttons.turn_right};
  const int32_t units = direction * speed - buttons.yaw_delta;
  body.angle += static_cast<Angle>(units) << 16;
  if (buttons.turn_180 && player.turn_180_tics == 0) player.turn_180_tics = kTurnAroundTics;
  if (player.turn_180_tics > 0) {
    body.angle += kAngle180 / kTurnAroundTics;
    --player.turn_180_tics;
  }
  if (buttons.pitch_delta != 0) {
    const int64_t pitch = int64_t{static_cast<int32_t>(body.pitch)} - (int64_t{buttons.pitch_delta} << 16);
    body.pitch = static_cast<Angle>(static_cast<int32_t>(std::clamp<int64_t>(pitch, kPitchUpMax, kPitchDownMax)));
  }
}

void PlayerThinker::push(Player& player, Actor& body, const Buttons& buttons) {
  const bool on_ground = body.z <= body.floor_z;
  const Fixed air_control = world_.state().air_control;
  const auto thrust = [&](int32_t strength, Angle angle) {
    const Fixed force = on_ground ? strength * kPushUnit : fixed_mul(strength * kPushUnit, air_control);
    body.velocity_x += fixed_mul(force, fine_cosine(angle));
    body.velocity_y += fixed_mul(force, fine_sine(angle));
  };
  const int32_t forward = forward_units(buttons), side = side_units(buttons);
  if (body.speed != kFracUnit && body.speed > 0) {
    // Scripts make players faster or slower (APROP_Speed).
    if (forward != 0) thrust(fixed_mul(forward, body.speed), body.angle);
    if (side != 0) thrust(fixed_mul(side, body.speed), body.angle - kAngle90);
  } else if (body.speed != 0) {
    if (forward != 0) thrust(forward, body.angle);
    if (side != 0) thrust(side, body.angle - kAngle90);
  }

  if ((forward != 0 || side != 0) && body.state == world_.type_of(body).state(StateLabel::kSpawn))
    world_.set_label(body, StateLabel::kSee);

  if (player.jump_tics > 0) --player.jump_tics;
  if (buttons.jump && on_ground && player.jump_tics == 0 && world_.options().allow_jump) {
    body.velocity_z += world_.type_of(body).jump_speed;
    player.jump_tics = -1;
  }
}

void PlayerThinker::move_eye(Player& player, const Actor& body) {
  if (!player.alive) {
    player.view_height = std::max(player.view_height - kFracUnit, kEyeHeightDead);
    player.view_height_delta = 0;
    player.view_z = body.z + player.view_height;
    return;
  }
  // Bob: a wave of 20 tics whose height grows with the square of the speed, before this tic's friction.
  const int64_t speed_squared =
      (int64_t{body.velocity_x} * body.velocity_x + int64_t{body.velocity_y} * body.velocity_y) >> kFracBits;
  const auto bob = static_cast<Fixed>(std::min<int64_t>((speed_squared * kBobFactor) >> kFracBits, kBobMax));
  const auto phase = static_cast<Angle>(8192 * world_.tic_count() / kBobTics) << 19;
  // The eye returns to its height after a step or a landing, faster and faster.
  player.view_height += player.view_height_delta;
  if (player.view_height > kEyeHeight) {
    player.view_height = kEyeHeight;
    player.view_height_delta = 0;
  } else if (player.view_height < kEyeHeight / 2) {
    player.view_height = kEyeHeight / 2;
    player.view_height_delta = std::max(player.view_height_delta, 1);
  }
  if (player.view_height_delta != 0) {
    player.view_height_delta += kEyeRise;
    if (player.view_height_delta == 0) player.view_height_delta = 1;
  }
  player.view_z = body.z + player.view_height + fixed_mul(bob / 2, fine_sine(phase));
  player.view_z = std::min(player.view_z, body.ceiling_z - to_fixed(4));
}

void PlayerThinker::think_dead(int player_index, Player& player, Actor& body) {
  move_eye(player, body);
  tic_weapon(world_, player_index);
  // The dead look at who killed them.
  if (const Actor* attacker = world_.find_actor(player.attacker_id); attacker != nullptr && attacker->id != body.id) {
    const Angle wanted = angle_to(body.x, body.y, attacker->x, attacker->y);
    const Angle difference = wanted - body.angle;
    constexpr Angle kStep = kAngle90 / 18;
    if (difference < kStep || difference > 0u - kStep) {
      body.angle = wanted;
    } else {
      body.angle += difference < kAngle180 ? kStep : 0u - kStep;
    }
  }
  if (player.respawn_tics > 0) {
    --player.respawn_tics;
    return;
  }
  if (world_.options().forced_respawn) world_.respawn_player(player_index);
}

void PlayerThinker::think(int player_index, const Buttons& buttons) {
  Player& player = world_.state().players[static_cast<std::size_t>(player_index)];
  player.buttons = buttons;
  player.damage_flash = std::max(player.damage_flash - 1, 0);
  player.bonus_flash = std::max(player.bonus_flash - 1, 0);
  Actor* body = world_.actor(player.actor_id);
  if (body == nullptr) return;
  if (!player.alive) {
    think_dead(player_index, player, *body);
    return;
  }
  if (!player.totally_frozen) {
    turn(player, *body, buttons);
    if (body->reaction_tics > 0) {
      --body->reaction_tics;  // just teleported
    } else if (!player.frozen) {
      push(player, *body, buttons);
    }
  }
  move_eye(player, *body);
  tic_powers(world_, player_index);
  if (!player.totally_frozen) {
    choose_weapon(world_, player_index, buttons);
    if (buttons.use && !player.use_down) use_lines(world_, *body);
    player.use_down = buttons.use;
    tic_weapon(world_, player_index);
    player.attack_down = buttons.attack;
  }
  if (body->removed || !player.alive) return;
  tic_player_in_sector(world_, player_index);
}

}  // namespace comrad::doom
