// A player: what it presses, what it carries, what it holds in its hand. Its body is an Actor. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "sim_workers/engine/actors/actor_type.h"
#include "sim_workers/engine/fixed.h"

namespace comrad::doom {

/// What one player presses during one tic. Binary buttons as ViZDoom names them.
struct Buttons {
  bool forward = false, backward = false, left = false, right = false;  ///< move; left and right strafe
  bool turn_left = false, turn_right = false;
  bool attack = false, use = false, jump = false, speed = false;
  int8_t select_weapon = -1;  ///< slot, or -1
  bool alt_attack = false, crouch = false, turn_180 = false, strafe = false, reload = false, zoom = false;
  bool look_up = false, look_down = false, move_up = false, move_down = false, land = false, use_item = false;
  bool select_next_weapon = false, select_previous_weapon = false, drop_weapon = false;
  bool select_next_item = false, select_previous_item = false;
  // Delta buttons, as the engine takes them: angles in 65536ths of a turn, moves in the units of the walk
  // keys (25 forward, 24 to a side, 50 at most).
  int32_t yaw_delta = 0;                                    ///< positive turns right
  int32_t pitch_delta = 0;                                  ///< positive looks up
  int32_t forward_delta = 0, side_delta = 0, up_delta = 0;  ///< forward and right are positive

  bool operator==(const Buttons&) const = default;
};

struct InventoryItem {
  uint32_t type = kNoType;
  int32_t amount = 0;
  int32_t max_amount = 0;
};

/// The weapon or its flash, drawn over the view; Doom's psprite.
struct WeaponSprite {
  uint32_t state = kNoState;
  int32_t tics = 0;
  Fixed x = 0, y = 0;          ///< of 320x200, drawn here; y grows downwards, 32 is raised
  Fixed own_x = 0, own_y = 0;  ///< the same without the bob
};

/// What the weapon's present state lets the player do; WeaponReady grants, the next state takes away.
enum WeaponPermission : uint8_t {
  kMayFire = 1u << 0,
  kMayBob = 1u << 1,
  kMaySwitch = 1u << 2,
  kMayFireAlternately = 1u << 3,
  kTriggerHeld = 1u << 5,      ///< stays: not let go since the last shot out of WeaponReady
  kNoSwitch = 1u << 6,         ///< stays until the next WeaponReady: not even between shots
  kMaySwitchInBurst = 1u << 7  ///< stays: between two shots
};

constexpr int32_t kFieldOfView = 90, kFieldOfViewAfterTeleport = 135;  ///< degrees

struct Power {
  PowerKind kind = PowerKind::kNone;
  uint32_t type = kNoType;
  int32_t tics = 0;      ///< left; -1 for ever
  bool is_fresh = true;  ///< given in this tic, which counts too
};

enum class PlayerState : uint8_t { kAlive, kDead, kReborn };

struct Player {
  uint32_t actor_id = 0;
  int32_t health = 100;
  int32_t armor = 0;     ///< points
  Fixed armor_save = 0;  ///< part of damage that it takes, 16.16 of one
  uint32_t armor_type = kNoType;
  bool alive = true;
  PlayerState state = PlayerState::kAlive;
  std::vector<InventoryItem>
      inventory;  ///< ammunition, weapons, keys, whatever scripts give; in order of taking
  std::vector<Power> powers;
  bool has_backpack = false;
  uint32_t selected_item = kNoType;  ///< of the inventory bar; one that it does not hold: the first taken
  int32_t item_bar_tics = 0;         ///< that the bar is still open

  // The hand.
  uint32_t ready_weapon = kNoType, pending_weapon = kNoType;  ///< pending kNoType: no change requested
  std::array<WeaponSprite, 2> weapon_sprites{};               ///< weapon, flash
  bool fires_alternately = false;              ///< the shot under way, or the last one, is AltFire's
  int32_t refire = 0;                          ///< shots of the present burst before this one
  bool attack_down = false, use_down = false;  ///< held since the last tic
  bool next_weapon_down = false, previous_weapon_down = false;
  int32_t extra_light = 0;
  bool weapon_ready = false;       ///< a state of WeaponReady lasts: it may fire (ViZDoom's ATTACK_READY)
  uint8_t weapon_permissions = 0;  ///< WeaponPermission bits
  int8_t select_weapon_down = -1;  ///< slot key held since the last tic; -1 none
  Fixed weapon_bob = 0;            ///< of the sprite: follows `bob`, fades out while it fires
  int32_t reload_counter = 0;      ///< of CheckForReload
  uint8_t weapon_state_depth = 0;  ///< zero outside of set_weapon_state(): bounds its recursion
  uint32_t attacker_id = 0;        ///< who hurt it last

  // Motion.
  bool on_ground = false;  ///< as its thinker last saw it, before the move of that tic
  int32_t turn_held_tics = 0;
  int32_t turn_180_tics = 0;
  int32_t jump_tics = 0;  ///< until the next jump; below 0 since a jump that has not landed, counting down
  Fixed crouch_factor = kFracUnit;
  bool stands_up =
      false;  ///< a jump ended its crouching, until the crouch key is pressed without the jump key
  Fixed eye_height = to_fixed(41);  ///< of one that stands: its class's, or a script's
  Fixed jump_speed = to_fixed(8), attack_z_offset = to_fixed(8);  ///< as that
  Fixed view_height = to_fixed(41);
  Fixed view_z = 0;              ///< eye height above zero, bob included
  Fixed view_height_delta = 0;   ///< how fast view_height returns after a step or a landing
  Fixed walk_x = 0, walk_y = 0;  ///< the part of its velocity that its keys made: the bob follows it
  Fixed bob = 0;                 ///< strength of the bob, grows with the square of the speed
  bool frozen = false, totally_frozen = false, no_clip = false, god_mode = false, buddha = false,
       no_target = false;
  bool instant_switch = false;  ///< weapons go down and come up within a tic

  // What the screen shows.
  int32_t damage_flash = 0;              ///< red, counts down a tic at a time
  int32_t bonus_flash = 0;               ///< gold
  uint32_t camera_id = 0;                ///< whose eyes; 0 its own
  int32_t field_of_view = kFieldOfView;  ///< degrees; wider after a teleport

  // Counts, totals since the start.
  int32_t damage_taken = 0, damage_dealt = 0, hits_taken = 0, hits_dealt = 0;
  int32_t pickup_count = 0;  ///< items taken
  int32_t item_count = 0, secret_count = 0, frag_count = 0, death_count = 0;
  uint64_t death_tic = 0;
  int32_t respawn_tics = 0;  ///< until a dead player may come back
  int32_t respawn_count = 0;
  Buttons buttons;  ///< of this tic

  /// What the game makes of the buttons: nothing while it is totally frozen.
  Buttons effective_buttons() const { return totally_frozen ? Buttons() : buttons; }
  bool has_power(PowerKind kind) const {
    for (const Power& power : powers)
      if (power.kind == kind && power.tics != 0) return true;
    return false;
  }
};

}  // namespace comrad::doom
