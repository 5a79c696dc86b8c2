// The classes that others descend from. They have no editor numbers: nobody meets one of them in a map.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

struct BaseItem {
  const char* name;
  const char* parent;
  ItemClass item_class;
  FlagList flags;
};

}  // namespace

void add_base_types(ActorCatalog* catalog) {
  ActorType actor;
  actor.name = "Actor";
  // What a corpse turns into under a door, and what is left of one that was shot to pieces.
  add_type(catalog, std::move(actor), "Spawn: TNT1 A -1; gone; GenericCrush: POL5 A -1; gone");

  ActorType inventory = start_type(*catalog, "Actor", "Inventory");
  inventory.item_class = ItemClass::kInventory;
  inventory.flags.set(ActorFlag::kSpecial);
  add_type(catalog, std::move(inventory), "");

  using enum ActorFlag;
  const BaseItem items[] = {
      {"FakeInventory", "Inventory", ItemClass::kInventory, {}},
      {"CustomInventory", "Inventory", ItemClass::kCustomInventory, {}},
      {"ScoreItem", "Inventory", ItemClass::kInventory, {kAlwaysPickup, kCountItem}},
      {"Health", "Inventory", ItemClass::kHealth, {}},
      {"MaxHealth", "Health", ItemClass::kMaxHealth, {}},
      {"HealthPickup", "Inventory", ItemClass::kInventory, {kInvBar}},
      {"Armor", "Inventory", ItemClass::kArmor, {}},
      {"BasicArmor", "Armor", ItemClass::kArmor, {kKeepDepleted}},
      {"BasicArmorPickup", "Armor", ItemClass::kArmor, {kAutoActivate}},
      {"BasicArmorBonus", "Armor", ItemClass::kArmorBonus, {kAutoActivate, kAlwaysPickup}},
      {"Ammo", "Inventory", ItemClass::kAmmo, {kKeepDepleted}},
      {"BackpackItem", "Inventory", ItemClass::kBackpack, {}},
      {"Key", "Inventory", ItemClass::kKey, {kDontGib}},
      {"DoomKey", "Key", ItemClass::kKey, {}},
      {"MapRevealer", "Inventory", ItemClass::kMap, {}},
      {"Powerup", "Inventory", ItemClass::kPowerup, {}},
      {"PowerupGiver", "Inventory", ItemClass::kPowerup, {kInvBar, kFancyPickup}},
      {"PuzzleItem", "Inventory", ItemClass::kInventory, {kInvBar}},
      {"WeaponPiece", "Inventory", ItemClass::kInventory, {}},
  };
  for (const BaseItem& row : items) {
    ActorType type = start_type(*catalog, row.parent, row.name);
    type.item_class = row.item_class;
    set_flags(&type, row.flags);
    if (row.item_class == ItemClass::kHealth) type.max_amount = 0;
    if (std::string_view(row.name) == "ScoreItem") type.height = to_fixed(10);
    add_type(catalog, std::move(type), "");
  }
  ActorType weapon = start_type(*catalog, "Inventory", "Weapon");
  weapon.item_class = ItemClass::kWeapon;
  add_type(catalog, std::move(weapon), "LightDone: SHTG E 0 Light0; gone");
  add_type(catalog, start_type(*catalog, "Weapon", "DoomWeapon"), "");

  ActorType pawn = start_type(*catalog, "Actor", "PlayerPawn");
  pawn.is_player = true;
  pawn.health = 100, pawn.mass = 100, pawn.pain_chance = 255, pawn.speed = kFracUnit;
  pawn.radius = to_fixed(16), pawn.height = to_fixed(56);
  set_flags(&pawn, {kSolid, kShootable, kDropOff, kPickup, kFloorClip, kCanPass, kPushWall, kSlidesOnWalls});
  add_type(catalog, std::move(pawn), "");

  ActorType switchable = start_type(*catalog, "Actor", "SwitchableDecoration");
  add_type(catalog, std::move(switchable), "");
  add_type(catalog, start_type(*catalog, "SwitchableDecoration", "SwitchingDecoration"), "");
  add_type(catalog, start_type(*catalog, "Actor", "RandomSpawner"), "");
}

}  // namespace comrad::doom
