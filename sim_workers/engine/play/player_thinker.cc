#include "sim_workers/engine/play/player_thinker.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/play/weapons.h"

namespace comrad::doom {
namespace {

// Turning, in 65536ths of a turn per tic. The slow start lasts kSlowTurnTics, whatever the direction.
constexpr uint64_t kHealthFallsEveryTics = 35;  // of sv_degeneration
constexpr int32_t kFieldOfViewStep = 7;         // degrees a tic
constexpr int32_t kTurnSlow = 320, kTurnWalk = 640, kTurnRun = 1280;
constexpr int kSlowTurnTics = 5;
// Pushes, in 1/32 unit per tic^2.
constexpr int32_t kForwardWalk = 25, kForwardRun = 50, kSideWalk = 24, kSideRun = 40;
constexpr Fixed kPowerSpeed = kFracUnit * 3 / 2;
constexpr int kTurnAroundTics = 9;
constexpr int kJumpForgottenTics = 19;  // from a jump without a landing to the next, plus one
constexpr int32_t kLookWalk = 450, kLookRun = 512;
constexpr Fixed kCrouchStep = kFracUnit / 12, kCrouchFactorMin = kFracUnit / 2;
constexpr int64_t kPushMax = int64_t{to_fixed(1000)};
constexpr int64_t kDegree = 0x40000000 / 90;  // as the limits of the pitch count it, a little short
constexpr int64_t kPitchUpMax = -32 * kDegree, kPitchDownMax = 56 * kDegree;
// The eye.
constexpr Fixed kBobMax = to_fixed(16);
constexpr Fixed kBobFactor = kFracUnit / 4;
constexpr uint64_t kBobTics = 20;
constexpr Fixed kEyeHeightDead = to_fixed(6);
constexpr Fixed kEyeRise = kFracUnit / 4;
constexpr int32_t kDeadLook = 3 * (0x40000000 / 90);  // a tic

/// One point of what is above a full body's; the last four at once, as in ViZDoom.
void lose_surplus_health(const World& world, Player& player, Actor& body) {
  const int32_t full = world.type_of(body).health;
  if (body.health > full) player.health = body.health = body.health < full + 5 ? full : body.health - 1;
}

/// In mud a faster body pushes better.
int32_t mud_grip(const Footing& footing, const Actor& body) {
  if (footing.friction >= kGroundFriction) return 1;
  constexpr Fixed kSlow = 15'000;
  const Fixed speed = approximate_distance(body.velocity_x, body.velocity_y);
  return speed > 4 * kSlow ? 8 : speed > 2 * kSlow ? 4 : speed > kSlow ? 2 : 1;
}

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
  const int32_t keys =
      (int32_t{strafing_right} - int32_t{strafing_left}) * (buttons.speed ? kSideRun : kSideWalk);
  return std::clamp(keys + buttons.side_delta, -kForwardRun, kForwardRun);
}

int32_t PlayerThinker::yaw_units(const Player& player, const Buttons& buttons) {
  const int32_t speed = player.turn_held_tics <= kSlowTurnTics ? kTurnSlow
                        : buttons.speed                        ? kTurnRun
                                                               : kTurnWalk;
  const int32_t direction = buttons.strafe ? 0 : int32_t{buttons.turn_left} - int32_t{buttons.turn_right};
  return direction * speed - buttons.yaw_delta;
}

int64_t PlayerThinker::pitch_units(const Buttons& buttons) {
  const int32_t keys =
      (int32_t{buttons.look_up} - int32_t{buttons.look_down}) * (buttons.speed ? kLookRun : kLookWalk);
  return int64_t{keys} + buttons.pitch_delta;
}

Angle PlayerThinker::clamped_pitch(int64_t pitch) {
  return static_cast<Angle>(static_cast<int32_t>(std::clamp<int64_t>(pitch, kPitchUpMax, kPitchDownMax)));
}

void PlayerThinker::turn(Player& player, Actor& body, const Buttons& buttons) {
  // Turning round takes nine tics in which nothing else turns.
  if (player.turn_180_tics > 0) {
    --player.turn_180_tics;
    body.angle += kAngle180 / kTurnAroundTics;
    return;
  }
  body.angle += static_cast<Angle>(yaw_units(player, buttons)) << 16;
}

void PlayerThinker::look(Actor& body, const Buttons& buttons) {
  if (!world_.options().free_look) {
    body.pitch = 0;
    return;
  }
  const int64_t units = pitch_units(buttons);
  if (units == 0) return;
  body.pitch = clamped_pitch(int64_t{static_cast<int32_t>(body.pitch)} - units * (1 << 16));
}

void PlayerThinker::crouch(Player& player, Actor& body, const Buttons& buttons) {
  const bool presses = buttons.crouch && !buttons.jump && world_.options().allow_crouch;
  const bool ducks = presses && !player.stands_up;
  if (presses) player.stands_up = false;
  Fixed wanted = player.crouch_factor;
  const Fixed full_height = world_.type_of(body).height;
  if (ducks) {
    wanted = std::max(wanted - kCrouchStep, kCrouchFactorMin);
  } else if (wanted < kFracUnit && int64_t{body.z} + body.height < body.ceiling_z) {
    // Room for the whole step is needed, also for the last one, which is cut short: below 61 units nobody of 56
    // gets up far enough to jump.
    const Fixed height = body.height;
    body.height = fixed_mul(full_height, wanted + kCrouchStep);
    const bool fits = Movement(world_).could_step_to(world_.slot_of(body), body.x, body.y);
    body.height = height;
    if (!fits) return;
    wanted = std::min(wanted + kCrouchStep, kFracUnit);
  }
  if (wanted == player.crouch_factor) return;
  body.height = fixed_mul(full_height, wanted);
  player.crouch_factor = wanted;
  player.view_height = eye_height(player);
  if (ducks) Movement(world_).could_step_to(world_.slot_of(body), body.x, body.y);  // takes what lies there
}

Fixed PlayerThinker::eye_height(const Player& player) {
  return fixed_mul(player.eye_height, player.crouch_factor);
}

void PlayerThinker::push(Player& player, Actor& body, const Buttons& buttons) {
  const bool on_ground = player.on_ground;
  const Fixed air_control = world_.state().air_control;
  const Footing footing = footing_of(world_, body);
  const int32_t move_factor =
      on_ground ? footing.move_factor * mud_grip(footing, body) : fixed_mul(kSectorMoveFactor, air_control);
  // The bob does not show that feet slip on ice. Crouching lowers its factor, cut to a whole number (measured: from 8 in the air to
  // 7 after standing up, at a height slightly below the full one).
  const int32_t step_factor =
      fixed_mul(on_ground && footing.friction > kGroundFriction ? kSectorMoveFactor : move_factor,
                player.crouch_factor);
  // Scripts make players faster or slower (APROP_Speed), which the bob does not show; crouching slows, too.
  // 256 to a unit of the keys.
  const auto force_of = [](int32_t strength, int32_t factor) {
    return static_cast<Fixed>(std::clamp<int64_t>(int64_t{strength} * factor / 256, -kPushMax, kPushMax));
  };
  const Fixed speed = player.has_power(PowerKind::kSpeed) ? fixed_mul(body.speed, kPowerSpeed) : body.speed;
  const auto thrust = [&](int32_t units, Angle angle) {
    const Fixed strength = fixed_mul(fixed_mul(units * 256, speed), player.crouch_factor);
    body.push(angle, force_of(strength, move_factor));
    const Fixed step = force_of(units * 256, step_factor);
    player.walk_x = clamped_fixed(int64_t{player.walk_x} + fixed_mul(step, fine_cosine(angle)));
    player.walk_y = clamped_fixed(int64_t{player.walk_y} + fixed_mul(step, fine_sine(angle)));
  };
  const int32_t forward = player.frozen ? 0 : forward_units(buttons),
                side = player.frozen ? 0 : side_units(buttons);  // and still jumps
  if (forward != 0) thrust(forward, body.angle);
  if (side != 0) thrust(side, body.angle - kAngle90);

  if ((forward != 0 || side != 0) && body.state == world_.type_of(body).state(StateLabel::kSpawn))
    set_label(world_, body, StateLabel::kSee);

  if (buttons.jump && player.crouch_factor != kFracUnit) player.stands_up = true;
  if (buttons.jump && player.crouch_factor == kFracUnit && on_ground && player.jump_tics == 0 &&
      world_.options().allow_jump) {
    body.velocity_z = clamped_fixed(int64_t{body.velocity_z} + player.jump_speed);
    player.jump_tics = -1;
  }
}

void PlayerThinker::move_eye(Player& player, const Actor& body) {
  // Bob: a wave of 20 tics whose height grows with the square of the speed, before this tic's friction. What blows,
  // recoils and scripts add to the speed does not count.
  const int64_t speed_squared =
      (int64_t{player.walk_x} * player.walk_x + int64_t{player.walk_y} * player.walk_y) >> kFracBits;
  const auto bob = static_cast<Fixed>(std::min<int64_t>((speed_squared * kBobFactor) >> kFracBits, kBobMax));
  player.bob = bob;
  const auto phase = static_cast<Angle>(8192 * world_.tic_count() / kBobTics) << 19;
  // The dead sink. The eye of the living returns to its height after a step or a landing, faster and faster.
  const Fixed normal = eye_height(player);
  if (!player.alive) {
    player.view_height = std::max(player.view_height - kFracUnit, kEyeHeightDead);
    player.view_height_delta = 0;
  } else {
    player.view_height += player.view_height_delta;
  }
  if (player.alive && player.view_height > normal) {
    player.view_height = normal;
    player.view_height_delta = 0;
  } else if (player.alive && player.view_height < normal / 2) {
    player.view_height = normal / 2;
    player.view_height_delta = std::max(player.view_height_delta, 1);
  }
  if (player.view_height_delta != 0) {
    player.view_height_delta += kEyeRise;
    if (player.view_height_delta == 0) player.view_height_delta = 1;
  }
  player.view_z = clamped_fixed(int64_t{body.z} + player.view_height + fixed_mul(bob / 2, fine_sine(phase)));
  constexpr Fixed kGap = to_fixed(4);
  player.view_z = std::max(std::min(player.view_z, body.ceiling_z - kGap), body.floor_z + kGap);
}

void PlayerThinker::think_dead(int player_index, Player& player, Actor& body) {
  move_eye(player, body);
  tic_weapon(world_, player_index);
  // The dead look ahead and turn to their attacker.
  const auto pitch = static_cast<int32_t>(body.pitch);
  body.pitch = std::abs(int64_t{pitch}) < 2 * kDeadLook
                   ? 0u
                   : body.pitch - static_cast<Angle>(pitch < 0 ? -kDeadLook : kDeadLook);
  if (const Actor* attacker = world_.find_actor(player.attacker_id);
      attacker != nullptr && attacker->id != body.id) {
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
  const bool asks = world_.options().network_game && player.buttons.use;
  if (world_.options().forced_respawn || asks) respawn_player(world_, player_index);
}

bool PlayerThinker::think(int player_index, const Buttons& pressed) {
  Buttons buttons = pressed;
  buttons.speed = pressed.speed != world_.options().always_run;
  Player& player = world_.state().players[static_cast<std::size_t>(player_index)];
  if (buttons.turn_180 && !player.buttons.turn_180) player.turn_180_tics = kTurnAroundTics;
  const Buttons before = std::exchange(player.buttons, buttons);
  player.damage_flash = std::max(player.damage_flash - 1, 0);
  player.field_of_view = std::max(player.field_of_view - kFieldOfViewStep, kFieldOfView);
  player.bonus_flash = std::max(player.bonus_flash - 1, 0);
  Actor* body = world_.actor(player.actor_id);
  if (body == nullptr) return false;
  if (!player.alive) {
    think_dead(player_index, player, *body);
    return false;
  }
  choose_item(world_, player_index, before, buttons);
  // Counted while any turn is held, also across a change of direction, and whether the turn counts or not.
  player.turn_held_tics = buttons.turn_left || buttons.turn_right ? player.turn_held_tics + 1 : 0;
  if (!player.totally_frozen) {
    look(*body, buttons);
    crouch(player, *body, buttons);
  }
  if (player.jump_tics != 0) {
    --player.jump_tics;
    // A jump that a low ceiling or a teleport ended at once has no landing: it is forgotten after a while.
    if (player.on_ground && player.jump_tics <= -kJumpForgottenTics) player.jump_tics = 0;
  }
  if (body->reaction_tics > 0) {
    --body->reaction_tics;  // just born or teleported
  } else {
    if (!player.totally_frozen) turn(player, *body, buttons);
    player.on_ground = body->z <= body->floor_z;
    if (!player.totally_frozen) push(player, *body, buttons);
  }
  move_eye(player, *body);
  if (world_.has(wad::GameFlag::kDegeneration) && world_.tic_count() % kHealthFallsEveryTics == 0)
    lose_surplus_health(world_, player, *body);
  const Buttons effective = player.effective_buttons();
  if (!player.totally_frozen) choose_weapon(world_, player_index, buttons);
  if (effective.use && !player.use_down) use_lines(world_, *body);
  player.use_down = effective.use;
  return true;
}

void PlayerThinker::tic_hand(int player_index) {
  Player& player = world_.state().players[static_cast<std::size_t>(player_index)];
  tic_weapon(world_, player_index);
  player.attack_down = player.effective_buttons().attack;
}

}  // namespace comrad::doom
