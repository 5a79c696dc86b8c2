// What players pick up, weapons excepted.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

constexpr int32_t kSecond = 35;

struct Health {
  const char* name;
  int32_t number, spawn_id, amount, limit;
  FlagList flags;
  const char* program;
};

struct Armor {
  const char* name;
  const char* parent;
  int32_t number, spawn_id, amount, limit;
  Fixed percent;
  FlagList flags;
  const char* program;
};

struct Ammo {
  const char* name;
  const char* parent;
  int32_t number, spawn_id, amount, limit, backpack_amount, backpack_limit;
  const char* program;
};

struct Key {
  const char* name;
  int32_t number, spawn_id, lock;
  const char* program;
};

struct Power {
  const char* name;
  PowerKind kind;
  int32_t tics;
  std::array<uint8_t, 4> color;
};

struct PowerItem {
  const char* name;
  const char* power;
  int32_t number, spawn_id;
  FlagList flags;
  const char* program;
};

void add_powers(ActorCatalog* catalog) {
  // clang-format off
  const Power powers[] = {
      {"PowerInvulnerable", PowerKind::kInvulnerable, 30 * kSecond, {}},
      {"PowerStrength", PowerKind::kStrength, -1, {255, 0, 0, 128}},
      {"PowerInvisibility", PowerKind::kInvisibility, 60 * kSecond, {}},
      {"PowerIronFeet", PowerKind::kIronFeet, 60 * kSecond, {0, 255, 0, 32}},
      {"PowerLightAmp", PowerKind::kLightAmp, 120 * kSecond, {}},
      {"PowerTimeFreezer", PowerKind::kTimeFreeze, 12 * kSecond, {}},
      {"PowerFlight", PowerKind::kFlight, 60 * kSecond, {}},
      {"PowerSpeed", PowerKind::kSpeed, 45 * kSecond, {}},
      {"PowerDamage", PowerKind::kDoubleDamage, 25 * kSecond, {}},
      {"PowerProtection", PowerKind::kProtection, 25 * kSecond, {}},
  };
  // clang-format on
  for (const Power& row : powers) {
    ActorType type = start_type(*catalog, "Powerup", row.name);
    type.power = row.kind, type.power_tics = row.tics, type.power_color = row.color;
    add_type(catalog, std::move(type), "");
  }
  // clang-format off
  const PowerItem items[] = {
      {"InvulnerabilitySphere", "PowerInvulnerable", 2022, 133, {kCountItem, kBigPowerup},
       "Spawn: PINV ABCD 6*; again"},
      {"BlurSphere", "PowerInvisibility", 2024, 135, {kCountItem, kBigPowerup}, "Spawn: PINS ABCD 6*; again"},
      {"RadSuit", "PowerIronFeet", 2025, 136, {}, "Spawn: SUIT A -1*; gone"},
      {"Infrared", "PowerLightAmp", 2045, 138, {kCountItem}, "Spawn: PVIS A 6*; B 6; again"},
  };
  // clang-format on
  for (const PowerItem& row : items) {
    ActorType type = start_type(*catalog, "PowerupGiver", row.name, row.number, row.spawn_id);
    const ActorType& power = (*catalog)[type_index(*catalog, row.power)];
    type.power = power.power, type.power_tics = power.power_tics, type.power_color = power.power_color;
    type.max_amount = 0;
    set_flags(&type, {kAutoActivate, kAlwaysPickup});
    set_flags(&type, row.flags);
    if (std::string_view(row.name) == "RadSuit") type.height = to_fixed(46);
    if (std::string_view(row.name) == "BlurSphere")
      type.render_style = RenderStyle::kTranslucent, type.alpha = 0.5f;
    add_type(catalog, std::move(type), row.program);
  }
  ActorType map = start_type(*catalog, "MapRevealer", "Allmap", 2026, 137);
  map.power = PowerKind::kAllMap, map.power_tics = -1, map.max_amount = 0;
  set_flags(&map, {kCountItem, kAlwaysPickup, kFancyPickup});
  add_type(catalog, std::move(map), "Spawn: PMAP ABCDCB 6*; again");
}

}  // namespace

void add_items(ActorCatalog* catalog) {
  // clang-format off
  const Health health[] = {
      {"HealthBonus", 2014, 152, 1, 200, {kCountItem, kAlwaysPickup}, "Spawn: BON1 ABCDCB 6; again"},
      {"Stimpack", 2011, 23, 10, 0, {}, "Spawn: STIM A -1; gone"},
      {"Medikit", 2012, 24, 25, 0, {}, "Spawn: MEDI A -1; gone"},
      {"Soulsphere", 2013, 25, 100, 200, {kCountItem, kAutoActivate, kAlwaysPickup, kFancyPickup},
       "Spawn: SOUL ABCDCB 6*; again"},
      {"MegasphereHealth", -1, 0, 200, 200, {kAlwaysPickup}, ""},
      {"BerserkHealth", -1, 0, 100, 0, {kAlwaysPickup}, ""},
  };
  // clang-format on
  for (const Health& row : health) {
    ActorType type = start_type(*catalog, "Health", row.name, row.number, row.spawn_id);
    type.amount = row.amount, type.max_amount = row.limit;
    set_flags(&type, row.flags);
    add_type(catalog, std::move(type), row.program);
  }

  // ZDoom writes a third as 33.335 per cent.
  constexpr Fixed kThird = static_cast<Fixed>(0.33335 * kFracUnit), kHalf = kFracUnit / 2;
  // clang-format off
  const Armor armor[] = {
      {"ArmorBonus", "BasicArmorBonus", 2015, 22, 1, 200, kThird, {kCountItem, kAlwaysPickup},
       "Spawn: BON2 ABCDCB 6; again"},
      {"GreenArmor", "BasicArmorPickup", 2018, 68, 100, 0, kThird, {}, "Spawn: ARM1 A 6; B 7*; again"},
      {"BlueArmor", "BasicArmorPickup", 2019, 69, 200, 0, kHalf, {}, "Spawn: ARM2 A 6; B 6*; again"},
      {"BlueArmorForMegasphere", "BlueArmor", -1, 0, 200, 0, kHalf, {kAlwaysPickup}, ""},
  };
  // clang-format on
  for (const Armor& row : armor) {
    ActorType type = start_type(*catalog, row.parent, row.name, row.number, row.spawn_id);
    type.save_amount = row.amount, type.max_save_amount = row.limit, type.save_percent = row.percent;
    set_flags(&type, row.flags);
    add_type(catalog, std::move(type), row.program);
  }

  // clang-format off
  const Ammo ammo[] = {
      {"Clip", "Ammo", 2007, 11, 10, 200, 10, 400, "Spawn: CLIP A -1; gone"},
      {"ClipBox", "Clip", 2048, 139, 50, 200, 10, 400, "Spawn: AMMO A -1; gone"},
      {"Shell", "Ammo", 2008, 12, 4, 50, 4, 100, "Spawn: SHEL A -1; gone"},
      {"ShellBox", "Shell", 2049, 143, 20, 50, 4, 100, "Spawn: SBOX A -1; gone"},
      {"RocketAmmo", "Ammo", 2010, 140, 1, 50, 1, 100, "Spawn: ROCK A -1; gone"},
      {"RocketBox", "RocketAmmo", 2046, 141, 5, 50, 1, 100, "Spawn: BROK A -1; gone"},
      {"Cell", "Ammo", 2047, 75, 20, 300, 20, 600, "Spawn: CELL A -1; gone"},
      {"CellPack", "Cell", 17, 142, 100, 300, 20, 600, "Spawn: CELP A -1; gone"},
  };
  // clang-format on
  for (const Ammo& row : ammo) {
    ActorType type = start_type(*catalog, row.parent, row.name, row.number, row.spawn_id);
    type.amount = row.amount, type.max_amount = row.limit;
    type.backpack_amount = row.backpack_amount, type.backpack_max_amount = row.backpack_limit;
    add_type(catalog, std::move(type), row.program);
  }
  ActorType backpack = start_type(*catalog, "BackpackItem", "Backpack", 8, 144);
  backpack.flags.set(kAlwaysPickup);
  backpack.height = to_fixed(26);
  add_type(catalog, std::move(backpack), "Spawn: BPAK A -1; gone");

  // clang-format off
  const Key keys[] = {
      {"RedCard", 13, 86, 1, "Spawn: RKEY A 10; B 10*; again"},
      {"BlueCard", 5, 85, 2, "Spawn: BKEY A 10; B 10*; again"},
      {"YellowCard", 6, 87, 3, "Spawn: YKEY A 10; B 10*; again"},
      {"RedSkull", 38, 89, 4, "Spawn: RSKU A 10; B 10*; again"},
      {"BlueSkull", 40, 90, 5, "Spawn: BSKU A 10; B 10*; again"},
      {"YellowSkull", 39, 88, 6, "Spawn: YSKU A 10; B 10*; again"},
  };
  // clang-format on
  for (const Key& row : keys) {
    ActorType type = start_type(*catalog, "DoomKey", row.name, row.number, row.spawn_id);
    type.lock_key = row.lock;
    add_type(catalog, std::move(type), row.program);
  }

  add_powers(catalog);
}

/// Items whose use runs states; the weapon that they bring up must be there.
void add_custom_items(ActorCatalog* catalog) {
  ActorType berserk = start_type(*catalog, "CustomInventory", "Berserk", 2023, 134);
  set_flags(&berserk, {kCountItem, kAlwaysPickup});
  add_type(catalog, std::move(berserk),
           "Spawn: PSTR A -1*; gone;"
           "Pickup: TNT1 A 0 GiveInventory(PowerStrength); A 0 GiveInventory(BerserkHealth);"
           "A 0 SelectWeapon(Fist); gone");
  ActorType megasphere = start_type(*catalog, "CustomInventory", "Megasphere", 83, 132);
  set_flags(&megasphere, {kCountItem, kAlwaysPickup});
  add_type(catalog, std::move(megasphere),
           "Spawn: MEGA ABCD 6*; again;"
           "Pickup: TNT1 A 0 GiveInventory(BlueArmorForMegasphere); A 0 GiveInventory(MegasphereHealth); "
           "gone");
}

}  // namespace comrad::doom
