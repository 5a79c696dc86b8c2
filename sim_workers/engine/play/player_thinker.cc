#include "sim_workers/engine/play/player_thinker.h"

#include <algorithm>

#include "sim_workers/engine/play/actor_catalog.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/specials.h"

namespace comrad::doom {
namespace {

// Turning, in 65536ths of a turn per tic. The slow start lasts kSlowTurnTics, whatever the direction.
constexpr int32_t kTurnSlow = 320, kTurnWalk = 640, kTurnRun = 1280;
constexpr int kSlowTurnTics = 5;
// Pushes, in 1/32 unit per tic^2.
constexpr int32_t kForwardWalk = 25, kForwardRun = 50, kSideWalk = 24, kSideRun = 40;
constexpr Fixed kPushUnit = kFracUnit / 32;
constexpr Fixed kAirControl = 256;  // factor of pushes in the air, 0.0039
// The eye.
constexpr Fixed kBobMax = to_fixed(16);
constexpr Fixed kBobFactor = kFracUnit / 4;
constexpr uint64_t kBobTics = 20;
constexpr Fixed kEyeHeightDead = to_fixed(6);
constexpr Fixed kEyeRise = kFracUnit / 4;

}  // namespace

bool PlayerThinker::pushes(const Buttons& buttons) {
  return buttons.forward != buttons.backward || buttons.left != buttons.right;
}

void PlayerThinker::turn(Player& player, Actor& body, const Buttons& buttons) {
  // The counter goes on while any turn is held, also across a change of direction.
  player.turn_held_tics = buttons.turn_left || buttons.turn_right ? player.turn_held_tics + 1 : 0;
  const int32_t speed = player.turn_held_tics <= kSlowTurnTics ? kTurnSlow
                        : buttons.speed                        ? kTurnRun
                                                               : kTurnWalk;
  const int32_t direction = int32_t{buttons.turn_left} - int32_t{buttons.turn_right};
  body.angle += static_cast<Angle>(direction * speed) << 16;
}

void PlayerThinker::push(Player& player, Actor& body, const Buttons& buttons) {
  const bool on_ground = body.z <= body.floor_z;
  const auto thrust = [&](int32_t strength, Angle angle) {
    const Fixed force = on_ground ? strength * kPushUnit : fixed_mul(strength * kPushUnit, kAirControl);
    body.velocity_x += fixed_mul(force, fine_cosine(angle));
    body.velocity_y += fixed_mul(force, fine_sine(angle));
  };
  const int32_t forward =
      (int32_t{buttons.forward} - int32_t{buttons.backward}) * (buttons.speed ? kForwardRun : kForwardWalk);
  const int32_t side =
      (int32_t{buttons.right} - int32_t{buttons.left}) * (buttons.speed ? kSideRun : kSideWalk);
  if (forward != 0) thrust(forward, body.angle);
  if (side != 0) thrust(side, body.angle - kAngle90);

  const ActorType& type = world_.catalog()[body.type];
  const bool has_walk_frames = type.frames.size() > kPlayerDeathFrame;
  if (has_walk_frames && (forward != 0 || side != 0) && body.frame_index == kPlayerIdleFrame)
    world_.set_frame(body, kPlayerWalkFrame);

  if (player.jump_tics > 0) --player.jump_tics;
  if (buttons.jump && on_ground && player.jump_tics == 0) {
    body.velocity_z += kJumpSpeed;
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

void PlayerThinker::hurt_by_floor(int player_index) {
  const Actor& body = world_.body(player_index);
  const Sector& sector = world_.sectors()[body.sector_index];
  if (sector.damage_amount <= 0 || body.z > sector.floor_height) return;
  const uint64_t clock = world_.tic_count();
  // The map's own damage counts from clock 0; what a script set at map start, from the first tic after it.
  if (clock == 0 && sector.damage_amount != world_.level().sectors[body.sector_index].damage_amount) return;
  const int32_t damage = floor_damage_due(sector, clock);
  if (damage > 0) world_.damage_player(player_index, damage);
}

void PlayerThinker::think(int player_index, const Buttons& buttons) {
  Player& player = world_.players_[static_cast<std::size_t>(player_index)];
  player.damage_flash = std::max(player.damage_flash - 1, 0);
  player.bonus_flash = std::max(player.bonus_flash - 1, 0);
  Actor* body = world_.find_live(player.actor_id);
  if (body == nullptr) return;
  if (!player.alive) {
    move_eye(player, *body);
    return;
  }
  turn(player, *body, buttons);
  push(player, *body, buttons);
  move_eye(player, *body);
  // Attack, use and weapon changes hook in here.
  hurt_by_floor(player_index);
}

}  // namespace comrad::doom
