// What scripts ask of actors: making, moving, counting, finding out, and what players carry. Stage: tic.
#pragma once

#include <cstdint>
#include <span>

#include "sim_workers/engine/acs/caller.h"
#include "sim_workers/engine/play/placement.h"

namespace comrad::doom::acs {

/// True for places that a body may be put to: the map's coordinates end at 32000 units.
bool on_map(Fixed x, Fixed y, Fixed z);
/// 16.16 of a turn, as scripts have angles.
constexpr Angle to_angle(int32_t fraction) { return static_cast<uint32_t>(fraction) << 16; }
constexpr int32_t from_angle(Angle angle) { return static_cast<int32_t>(angle >> 16); }

// Making actors. How many were made.
int32_t spawn_thing(const Caller& caller, int32_t type_name, Fixed x, Fixed y, Fixed z, int32_t thing_id,
                    Angle angle, bool force);
/// At every actor with `spot_id`; 0: at the activator.
int32_t spawn_at_spots(const Caller& caller, int32_t type_name, int32_t spot_id, int32_t thing_id,
                       Angle angle, bool facing, bool force);
/// A missile (or anything) from every actor with `source_id`: speeds in eighths of a unit a tic.
int32_t spawn_projectile(const Caller& caller, int32_t source_id, uint32_t type, Angle angle, int32_t speed,
                         int32_t rise, int32_t gravity, int32_t new_thing_id);

/// Moves it where it fits; false: it stays. With fog at both ends.
bool set_position(const Caller& caller, Actor& actor, Fixed x, Fixed y, Fixed z, bool fog);
int32_t warp(const Caller& caller, std::span<const int32_t> args);
int32_t pick_actor(const Caller& caller, std::span<const int32_t> args);
/// Enters a state by label; with `exact` false "Death.Fire" may be "Death". How many did.
int32_t set_actor_state(const Caller& caller, int32_t thing_id, int32_t label, bool exact);
uint32_t find_state(const Caller& caller, const Actor& actor, std::string_view label, bool exact);
/// Harm for positive amounts, healing for negative ones. How many there were.
int32_t damage_thing(const Caller& caller, int32_t thing_id, int32_t amount, int32_t type_name);

// Counting. `kind` kNoType: any; `sector_tag` -1: anywhere.
int32_t count_things(const Caller& caller, uint32_t kind, int32_t thing_id, int32_t sector_tag);
int32_t count_things_by_number(const Caller& caller, int32_t spawn_id, int32_t thing_id, int32_t sector_tag);
int32_t count_things_by_name(const Caller& caller, int32_t name, int32_t thing_id, int32_t sector_tag);
int32_t classify_actor(const Caller& caller, int32_t thing_id);
int32_t unique_thing_id(World& world, int32_t first, int32_t limit);

// Inventory. Of nobody: of all players.
void give_inventory(const Caller& caller, Actor* actor, bool everyone, int32_t name, int32_t amount);
void take_inventory(const Caller& caller, Actor* actor, bool everyone, int32_t name, int32_t amount);
int32_t check_inventory(const Caller& caller, const Actor* actor, int32_t name);
int32_t use_inventory(const Caller& caller, Actor* actor, bool everyone, int32_t name);
void clear_inventory_of(const Caller& caller, Actor* actor, bool everyone);

}  // namespace comrad::doom::acs
