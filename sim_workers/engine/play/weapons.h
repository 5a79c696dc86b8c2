// The weapon in a player's hand: raising, firing, changing. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

constexpr Fixed kWeaponTop = to_fixed(32) + 3 * kFracUnit / 8, kWeaponBottom = to_fixed(128);

void set_weapon_state(World& world, int player, int layer, uint32_t state);
/// Brings up the pending weapon, or the one that is ready, from below.
void raise_weapon(World& world, int player);
void drop_weapon(World& world, int player);  ///< lowers it: the player died
/// Keys of this tic: slots (edge-triggered), next, previous.
void choose_weapon(World& world, int player, const Buttons& buttons);
/// Requests an owned weapon (A_SelectWeapon; `by_script`: SetWeapon); false: not owned.
bool select_weapon(World& world, int player, uint32_t type, bool by_script = false);
void fire_weapon(World& world, int player, bool alternately = false);
/// True where it has what a shot needs; otherwise picks another weapon, if `switches`.
bool check_ammo(World& world, int player, bool switches, bool alternately = false);
bool use_ammo(World& world, int player);               ///< one shot's; false without enough
void tic_weapon(World& world, int player);             ///< its states continue
uint32_t best_weapon(const World& world, int player);  ///< by selection order, with ammunition
int selected_slot(const World& world,
                  int player);  ///< SELECTED_WEAPON: -1 for none and for weapons in no slot
int selected_ammo(const World& world, int player);  ///< SELECTED_WEAPON_AMMO
/// AMMO0..AMMO9: ammunition of the first weapon known for a slot; 0 where that needs none, as the fist in
/// slot 1.
int ammo_of_slot(const World& world, int player, int slot);
int weapons_of_slot(const World& world, int player,
                    int slot);  ///< WEAPON0..WEAPON9: how many of them it owns

bool owns_weapon(const World& world, int player, uint32_t type);
/// Enough ammunition for a shot of this weapon (or it needs none).
bool has_ammo_for(const World& world, int player, uint32_t weapon_type, bool alternately = false);
/// Ammunition came where there was none: a weak weapon in the hand gives way to the best one that uses it.
void switch_for_ammo(World& world, int player, uint32_t ammo_type);
/// The weapon left the inventory: the hand is empty, or another weapon comes up.
void forget_weapon(World& world, int player, uint32_t type);
/// The hand holds nothing at once. `had_others`: the player had another weapon to bring up.
void empty_hand(World& world, int player, bool had_others);

}  // namespace comrad::doom
