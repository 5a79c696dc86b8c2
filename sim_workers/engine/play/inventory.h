// What players carry: giving, taking, picking up, ammunition, armour, keys, powers. Stage: tic.
#pragma once

#include <cstdint>
#include <string_view>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

inline Player& player_at(World& world, int index) {
  return world.state().players[static_cast<std::size_t>(index)];
}

constexpr int32_t kBonusFlashTics = 6;  ///< gold flash that every item taken adds

/// True where `item`, which `body` overlaps seen from above, is within the reach of its hands: from 32 units
/// below its feet to the top of its head.
bool within_reach(const Actor& body, const Actor& item);

/// True for items that stay where they are for the other players: keys, and weapons that the map placed.
bool stays_for_others(const World& world, const Actor& item);

/// A body touches an item: takes it if it can use it, with flash, counts, special and script events. True
/// when taken.
bool touch_item(World& world, Actor& body, Actor& item);
/// A tic of an item without a state: in a deathmatch what was taken comes back 1 050 tics later.
void return_item(World& world, Actor& item);

/// Gives as a script does: `amount` replaces the item's own (spec: 6 ClipBox are 6 bullets, times the skill's
/// factor); 0: the item's own. False where nothing could be given.
bool give_item(World& world, int player, uint32_t type, int32_t amount);
/// Takes up to `amount` (0: all). Returns what was taken.
int32_t take_item(World& world, int player, uint32_t type, int32_t amount);
int32_t count_item(const World& world, int player,
                   uint32_t type);  ///< Health, BasicArmor and Armor count as well
int32_t max_item(const World& world, int player, uint32_t type);
void set_max_item(World& world, int player, uint32_t type, int32_t max_amount);  ///< SetAmmoCapacity
void clear_inventory(World& world, int player);
/// What a fresh body has: the items of its class, or, where `before` contains what the player had when it died, what it keeps of that
/// by the game's flags.
void give_start_items(World& world, int player, const Player* before);
bool has_key(const World& world, const Actor& actor,
             int32_t lock);  ///< lock numbers as in Door_LockedRaise; 0 is open
/// A tic of the powers that were given before this tic, or of those that were given in it.
void tic_powers(World& world, int player, bool fresh);
/// Armour's part of `damage`; returns what is left for the body.
int32_t absorb_damage(World& world, int player, int32_t damage, DamageType type);
/// Uses an item that is kept (inventory bar, UseInventory). True when it was used.
bool use_item(World& world, int player, uint32_t type);
/// The keys of the inventory bar; `before` are those of the last tic.
void choose_item(World& world, int player, const Buttons& before, const Buttons& pressed);
/// Drops a dead monster's item.
Actor* drop_item(World& world, Actor& dropper, uint32_t type, int32_t amount, int32_t chance);
/// What an ammunition type counts as: a ClipBox is Clip.
uint32_t ammo_base(const ActorCatalog& catalog, uint32_t type);

}  // namespace comrad::doom
