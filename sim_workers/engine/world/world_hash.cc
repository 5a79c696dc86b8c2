#include "sim_workers/engine/world/world_hash.h"

#include <array>
#include <bit>
#include <concepts>
#include <iterator>
#include <string>
#include <type_traits>

#include "rollout_buffer/core/rng.h"

namespace comrad::doom {
namespace {

// Takes a struct apart into all of its fields, in their order, and adds each: a field more does not compile until it
// is named here.
#define COMRAD_HASHED(Type, ...)        \
  void add(const Type& hashed) {        \
    const auto& [__VA_ARGS__] = hashed; \
    add_all(__VA_ARGS__);               \
  }

class Hash {
 public:
  uint64_t value() const { return value_; }

  template <typename... Values>
  void add_all(const Values&... values) {
    (add(values), ...);
  }

  template <typename Number>
  requires std::is_arithmetic_v<Number> || std::is_enum_v<Number>
  void add(Number number) {
    if constexpr (std::same_as<Number, float>) {
      add(std::bit_cast<uint32_t>(number));
    } else {
      value_ = mix64(value_ ^ static_cast<uint64_t>(number)) + kGoldenGamma;
    }
  }
  template <typename List>
  requires requires(const List& list) { std::begin(list), std::end(list), std::size(list); }
  void add(const List& list) {
    add(std::size(list));
    for (const auto& element : list) add(element);
  }
  void add(const std::string& text) {
    add(text.size());
    uint64_t word = 0;  // eight letters at a time
    for (std::size_t i = 0; i < text.size(); ++i) {
      word = word << 8 | static_cast<unsigned char>(text[i]);
      if (i % 8 == 7 || i + 1 == text.size()) add(word), word = 0;
    }
  }
  void add(const ActorFlags& flags) { add(flags.hash()); }
  void add(const Rng& rng) { add(rng.state()); }

  COMRAD_HASHED(DamageDice, factor, exact)
  COMRAD_HASHED(FlatPlacement, offset_x, offset_y, scale_x, scale_y, rotation_degrees, light, light_absolute)
  COMRAD_HASHED(Sector, floor_height, ceiling_height, floor_texture, ceiling_texture, light, special, tag,
                damage_amount, damage_interval, damage_leak, damage_type, secret, gravity, friction,
                move_factor, special_friction, silent, hidden, no_falling_damage, light_color, fade_color,
                floor_placement, ceiling_placement)
  COMRAD_HASHED(Actor, id, type, x, y, z, velocity_x, velocity_y, velocity_z, angle, pitch, radius, height,
                floor_z, ceiling_z, dropoff_z, ground_z, roof_z, sector_index, floor_sector_index, flags,
                health, start_health, state, tics, sprite, frame, thing_id, thing_order, special, args,
                target_id, tracer_id, master_id, goal_id, last_enemy_id, last_heard_id, hate_thing_id,
                move_direction, move_count, reaction_tics, threshold, last_look_player, special_1, special_2,
                speed, float_speed, damage, damage_factor, gravity, mass, amount, score, bounce_count,
                damage_type, render_style, alpha, scale_x, scale_y, translation, player_index, removed,
                spawn_x, spawn_y, spawn_z, spawn_angle, spawn_tic)
  COMRAD_HASHED(Buttons, forward, backward, left, right, turn_left, turn_right, attack, use, jump, speed,
                select_weapon, alt_attack, crouch, turn_180, strafe, reload, zoom, look_up, look_down,
                move_up, move_down, land, use_item, select_next_weapon, select_previous_weapon, drop_weapon,
                select_next_item, select_previous_item, yaw_delta, pitch_delta, forward_delta, side_delta,
                up_delta)
  COMRAD_HASHED(InventoryItem, type, amount, max_amount)
  COMRAD_HASHED(WeaponSprite, state, tics, x, y, own_x, own_y)
  COMRAD_HASHED(Power, kind, type, tics, is_fresh)
  COMRAD_HASHED(Player, actor_id, health, armor, armor_save, armor_type, alive, state, inventory, powers,
                has_backpack, selected_item, item_bar_tics, ready_weapon, pending_weapon, weapon_sprites,
                fires_alternately, refire, attack_down, use_down, next_weapon_down, previous_weapon_down,
                extra_light, weapon_ready, weapon_permissions, select_weapon_down, weapon_bob, reload_counter,
                weapon_state_depth, attacker_id, on_ground, turn_held_tics, turn_180_tics, jump_tics,
                crouch_factor, stands_up, eye_height, jump_speed, attack_z_offset, view_height, view_z,
                view_height_delta, walk_x, walk_y, bob, frozen, totally_frozen, no_clip, god_mode, buddha,
                no_target, instant_switch, damage_flash, bonus_flash, camera_id, field_of_view, damage_taken,
                damage_dealt, hits_taken, hits_dealt, pickup_count, item_count, secret_count, frag_count,
                death_count, death_tic, respawn_tics, respawn_count, buttons)
  COMRAD_HASHED(ThingLink, next, previous, cell)
  COMRAD_HASHED(LineState, special, args, flags, id, alpha)
  COMRAD_HASHED(SideState, top, bottom, middle, scroll_x, scroll_y, retextured)
  COMRAD_HASHED(SectorMover, sector, kind, phase, type, speed, return_speed, low, high, low_2, high_2,
                wait_tics, left_tics, crush, tag, texture, new_special, light_tag, stair_delay, phase_offset,
                amplitude, base, target, model_sector, hexen_crush, stepwise, step_tics, pause_tics,
                step_left_tics, growth, removed)
  COMRAD_HASHED(LightEffect, sector, kind, low, high, left_tics, bright_tics, dark_tics, direction, start,
                end, elapsed, removed)
  COMRAD_HASHED(Scroller, kind, index, dx, dy, part)
  COMRAD_HASHED(SwitchTimer, side, part, left_tics, back_texture)
  COMRAD_HASHED(Polyobject, number, mirror, x, y, angle, crush, lines, vertices, offset, position, kind,
                speed, distance_left, distance_total, direction, turn_speed, turn_left, closing, endless,
                wait_tics, left_tics, target_x, target_y, has_target, hurts_on_touch)
  COMRAD_HASHED(MoverState, sectors, lights, scrollers, switches, polyobjects, plane_busy)
  COMRAD_HASHED(acs::CallFrame, return_address, local_base, local_count, discards_result, function)
  COMRAD_HASHED(acs::Thread, script, script_index, state, registered, state_data, address, activator_id, line,
                back_side, stack, locals, local_base, calls, function, result, hud_width, hud_height,
                hud_covers_bar, font, clip, wrap_width, print_buffer, print_starts, option_start)
  COMRAD_HASHED(acs::HudMessage, id, player, kind, text, font, color, x, y, hud_width, hud_height,
                hud_covers_bar, layer, additive, no_wrap, clip, wrap_width, age_tics, hold_tics,
                fade_out_tics, fade_in_tics, type_tics, alpha)
  COMRAD_HASHED(acs::PlaneWatcher, sector, ceiling, height, last, special, args, activator_id, line,
                back_side)
  COMRAD_HASHED(acs::MachineState, threads, map_variables, map_arrays, world_variables, world_arrays,
                global_arrays, dynamic_strings, free_strings, string_purge_at, dynamic_bytes, hud_messages,
                plane_watchers, old_buttons, nesting, instructions_left, instructions_per_tic, runaway_count,
                last_error)
  COMRAD_HASHED(WorldState::BrainState, next_spot, easy_skip)

  void add(const WorldState& world) {
    const auto& [tic_count, level_exited, leaves_level, exited_secretly, next_actor_id, next_thing_order,
                 actors, links, cell_heads, type_counts, sector_sound_target, sector_sound_tic, sound_blocks,
                 sound_queue, sound_queue_later, radius_max, has_removed, players, sectors, lines, sides,
                 movers, scripts, globals, monster_count, item_total, secret_total, kill_total, item_taken,
                 secret_found, has_special_friction, gravity, air_control, corpse_ids, brain, rng] = world;
    add_all(tic_count, level_exited, leaves_level, exited_secretly, next_actor_id, next_thing_order, actors,
            links, cell_heads, type_counts, sector_sound_target, sector_sound_tic, radius_max, has_removed,
            players, sectors, lines, sides, movers, scripts, globals, monster_count, item_total, secret_total,
            kill_total, item_taken, secret_found, has_special_friction, gravity, air_control, corpse_ids,
            brain, rng);
    // Not sound_blocks, sound_queue and sound_queue_later: scratch of alert_monsters().
  }

 private:
  uint64_t value_ = kGoldenGamma;
};
#undef COMRAD_HASHED

}  // namespace

uint64_t hash_of(const WorldState& state) {
  Hash hash;
  hash.add(state);
  return hash.value();
}

}  // namespace comrad::doom
