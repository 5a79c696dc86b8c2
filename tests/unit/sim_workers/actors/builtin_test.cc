// The built-in actors against the known facts of Doom II: health, body, speed, mass, pain and editor numbers,
// and what their states show for how long. Bodies, spawn numbers and flags were also read out of ViZDoom.
#include <gtest/gtest.h>

#include <set>

#include "tests/unit/sim_workers/actors/lump.h"

namespace comrad::doom::test {
namespace builtin_test {

struct MonsterFacts {
  const char* name;
  int number, spawn_id, health, radius, height, mass, speed, pain_chance;
  const char* drop;
};

TEST(Builtin, MonstersHaveDoomsNumbers) {
  const MonsterFacts facts[] = {
      {"ZombieMan", 3004, 4, 20, 20, 56, 100, 8, 200, "Clip"},
      {"ShotgunGuy", 9, 1, 30, 20, 56, 100, 8, 170, "Shotgun"},
      {"ChaingunGuy", 65, 2, 70, 20, 56, 100, 8, 170, "Chaingun"},
      {"WolfensteinSS", 84, 116, 50, 20, 56, 100, 8, 170, "Clip"},
      {"DoomImp", 3001, 5, 60, 20, 56, 100, 8, 200, nullptr},
      {"Demon", 3002, 8, 150, 30, 56, 400, 10, 180, nullptr},
      {"Spectre", 58, 9, 150, 30, 56, 400, 10, 180, nullptr},
      {"LostSoul", 3006, 110, 100, 16, 56, 50, 8, 256, nullptr},
      {"Cacodemon", 3005, 19, 400, 31, 56, 400, 8, 128, nullptr},
      {"PainElemental", 71, 115, 400, 31, 56, 400, 8, 128, nullptr},
      {"BaronOfHell", 3003, 3, 1000, 24, 64, 1000, 8, 50, nullptr},
      {"HellKnight", 69, 113, 500, 24, 64, 1000, 8, 50, nullptr},
      {"Revenant", 66, 20, 300, 20, 56, 500, 10, 100, nullptr},
      {"Fatso", 67, 112, 600, 48, 64, 1000, 8, 80, nullptr},
      {"Arachnotron", 68, 6, 500, 64, 64, 600, 12, 128, nullptr},
      {"SpiderMastermind", 7, 7, 3000, 128, 100, 1000, 12, 40, nullptr},
      {"Cyberdemon", 16, 114, 4000, 40, 110, 1000, 16, 20, nullptr},
      {"Archvile", 64, 111, 700, 20, 56, 500, 15, 10, nullptr},
      {"CommanderKeen", 72, 0, 100, 16, 72, 10000000, 0, 256, nullptr},
      {"BossBrain", 88, 0, 250, 20, 16, 10000000, 0, 255, nullptr},
  };
  const ActorCatalog& catalog = builtin_catalog();
  for (const MonsterFacts& fact : facts) {
    SCOPED_TRACE(fact.name);
    ASSERT_TRUE(catalog.find(fact.name).has_value());
    const ActorType& type = catalog[*catalog.find(fact.name)];
    EXPECT_EQ(type.editor_number, fact.number);
    EXPECT_EQ(type.spawn_id, fact.spawn_id);
    EXPECT_EQ(type.health, fact.health);
    EXPECT_EQ(type.radius, to_fixed(fact.radius));
    EXPECT_EQ(type.height, to_fixed(fact.height));
    EXPECT_EQ(type.mass, fact.mass);
    EXPECT_EQ(type.speed, to_fixed(fact.speed));
    EXPECT_EQ(type.pain_chance, fact.pain_chance);
    EXPECT_EQ(type.drop_items.empty(), fact.drop == nullptr);
    if (fact.drop != nullptr) {
      EXPECT_EQ(type.drop_items.at(0).type, catalog.find(fact.drop));
    }
    EXPECT_TRUE(type.flags.has(ActorFlag::kSolid) && type.flags.has(ActorFlag::kShootable));
    EXPECT_EQ(type.flags.has(ActorFlag::kCountKill), std::string_view(fact.name) != "BossBrain");
    EXPECT_NE(type.state(StateLabel::kSpawn), kNoState);
    EXPECT_NE(type.state(StateLabel::kDeath), kNoState);
  }
}

struct StateFacts {
  const char* name;
  const char* label;
  const char* states;
};

TEST(Builtin, MonstersStatesLastAsLongAsDooms) {
  const StateFacts facts[] = {
      {"ZombieMan", "Spawn", "POSSA10:Look POSSB10:Look @0"},
      {"ZombieMan", "See",
       "POSSA4:Chase POSSA4:Chase POSSB4:Chase POSSB4:Chase POSSC4:Chase POSSC4:Chase POSSD4:Chase "
       "POSSD4:Chase @0"},
      {"ZombieMan", "Missile", "POSSE10:FaceTarget POSSF8:PosAttack POSSE8 POSSA4:Chase"},
      {"ZombieMan", "Pain", "POSSG3 POSSG3:Pain POSSA4:Chase"},
      {"ZombieMan", "Death", "POSSH5 POSSI5:Scream POSSJ5:NoBlocking POSSK5 POSSL-1 ."},
      {"ZombieMan", "XDeath",
       "POSSM5 POSSN5:XScream POSSO5:NoBlocking POSSP5 POSSQ5 POSSR5 POSSS5 POSST5 POSSU-1 ."},
      {"ShotgunGuy", "Missile", "SPOSE10:FaceTarget SPOSF10*:SPosAttackUseAtkSound SPOSE10 SPOSA3:Chase"},
      {"ChaingunGuy", "Missile",
       "CPOSE10:FaceTarget CPOSF4*:CPosAttack CPOSE4*:CPosAttack CPOSF1:CPosRefire @1"},
      {"DoomImp", "Missile", "TROOE8:FaceTarget TROOF8:FaceTarget TROOG6:TroopAttack TROOA3:Chase"},
      {"DoomImp", "Melee", "TROOE8:FaceTarget TROOF8:FaceTarget TROOG6:TroopAttack TROOA3:Chase"},
      {"DoomImp", "Death", "TROOI8 TROOJ8:Scream TROOK6 TROOL6:NoBlocking TROOM-1 ."},
      {"Demon", "Melee", "SARGE8:FaceTarget SARGF8:FaceTarget SARGG8:SargAttack SARGA2:Chase"},
      {"Demon", "Death", "SARGI8 SARGJ8:Scream SARGK4 SARGL4:NoBlocking SARGM4 SARGN-1 ."},
      {"LostSoul", "Missile", "SKULC10*:FaceTarget SKULD4*:SkullAttack SKULC4* SKULD4* @2"},
      {"LostSoul", "Death", "SKULF6* SKULG6*:Scream SKULH6* SKULI6*:NoBlocking SKULJ6 SKULK6 ."},
      {"Cacodemon", "Missile", "HEADB5:FaceTarget HEADC5:FaceTarget HEADD5*:HeadAttack HEADA3:Chase"},
      {"BaronOfHell", "Missile", "BOSSE8:FaceTarget BOSSF8:FaceTarget BOSSG8:BruisAttack BOSSA3:Chase"},
      {"HellKnight", "Death", "BOS2I8 BOS2J8:Scream BOS2K8 BOS2L8:NoBlocking BOS2M8 BOS2N8 BOS2O-1 ."},
      {"Revenant", "Melee",
       "SKELG0:FaceTarget SKELG6:SkelWhoosh SKELH6:FaceTarget SKELI6:SkelFist SKELA2:Chase"},
      {"Revenant", "Missile",
       "SKELJ0*:FaceTarget SKELJ10*:FaceTarget SKELK10:SkelMissile SKELK10:FaceTarget SKELA2:Chase"},
      {"Fatso", "Missile",
       "FATTG20:FatRaise FATTH10*:FatAttack1 FATTI5:FaceTarget FATTG5:FaceTarget FATTH10*:FatAttack2 "
       "FATTI5:FaceTarget FATTG5:FaceTarget FATTH10*:FatAttack3 FATTI5:FaceTarget FATTG5:FaceTarget "
       "FATTA4:Chase"},
      {"Arachnotron", "Missile", "BSPIA20*:FaceTarget BSPIG4*:BspiAttack BSPIH4* BSPIH1*:SpidRefire @1"},
      {"Cyberdemon", "Missile",
       "CYBRE6:FaceTarget CYBRF12:CyberAttack CYBRE12:FaceTarget CYBRF12:CyberAttack CYBRE12:FaceTarget "
       "CYBRF12:CyberAttack CYBRA3:Hoof"},
      {"Archvile", "Missile",
       "VILEG0*:VileStart VILEG10*:FaceTarget VILEH8*:VileTarget VILEI8*:FaceTarget VILEJ8*:FaceTarget "
       "VILEK8*:FaceTarget VILEL8*:FaceTarget VILEM8*:FaceTarget VILEN8*:FaceTarget VILEO8*:VileAttack "
       "VILEP20* "
       "VILEA2:VileChase"},
      {"Archvile", "Heal", "VILE[10* VILE\\10* VILE]10* VILEA2:VileChase"},
      {"ExplosiveBarrel", "Death", "BEXPA5* BEXPB5*:Scream BEXPC5* BEXPD5*:Explode BEXPE10* TNT1A1050"},
      {"Rocket", "Death", "MISLB8*:Explode MISLC6* MISLD4* ."},
      {"DoomImpBall", "Death", "BAL1C6* BAL1D6* BAL1E6* ."},
      {"TeleportFog", "Spawn",
       "TFOGA6* TFOGB6* TFOGA6* TFOGB6* TFOGC6* TFOGD6* TFOGE6* TFOGF6* TFOGG6* TFOGH6* TFOGI6* TFOGJ6* ."},
      {"HealthBonus", "Spawn", "BON1A6 BON1B6 BON1C6 BON1D6 BON1C6 BON1B6 @0"},
      {"DoomPlayer", "Pain", "PLAYG4 PLAYG4:Pain PLAYA-1"},
      {"DoomPlayer", "Death",
       "PLAYH10 PLAYI10:PlayerScream PLAYJ10:NoBlocking PLAYK10 PLAYL10 PLAYM10 PLAYN-1 ."},
  };
  const ActorCatalog& catalog = builtin_catalog();
  for (const StateFacts& fact : facts) {
    const ActorType& type = catalog[*catalog.find(fact.name)];
    const std::string states = walk(catalog, type.find_label(fact.label), 40);
    EXPECT_EQ(states.rfind(fact.states, 0), 0u) << fact.name << " " << fact.label << ": " << states;
  }
}

TEST(Builtin, DemonsHurryInFastSkills) {
  const ActorCatalog& catalog = builtin_catalog();
  const ActorType& demon = catalog[*catalog.find("Demon")];
  EXPECT_TRUE(catalog.state(demon.state(StateLabel::kSee)).fast);
  EXPECT_TRUE(catalog.state(demon.state(StateLabel::kMelee)).fast);
  EXPECT_FALSE(catalog.state(demon.state(StateLabel::kDeath)).fast);
}

struct WeaponFacts {
  const char* name;
  int number, slot, selection_order;
  const char* ammo;
  int use, give;
  const char* fire;
};

TEST(Builtin, WeaponsHaveDoomsNumbers) {
  const WeaponFacts facts[] = {
      {"Fist", -1, 1, 3700, nullptr, 0, 0,
       "PUNGB4 PUNGC4:Punch PUNGD5 PUNGC4 PUNGB5:ReFire PUNGA1:WeaponReady"},
      {"Chainsaw", 2005, 1, 2200, nullptr, 0, 0, "SAWGA4:Saw SAWGB4:Saw SAWGB0:ReFire SAWGC4:WeaponReady"},
      {"Pistol", -1, 2, 1900, "Clip", 1, 20,
       "PISGA4 PISGB6:FirePistol PISGC4 PISGB5:ReFire PISGA1:WeaponReady"},
      {"Shotgun", 2001, 3, 1300, "Shell", 1, 8,
       "SHTGA3 SHTGA7:FireShotgun SHTGB5 SHTGC5 SHTGD4 SHTGC5 SHTGB5 SHTGA3 SHTGA7:ReFire "
       "SHTGA1:WeaponReady"},
      {"SuperShotgun", 82, 3, 400, "Shell", 2, 8,
       "SHT2A3 SHT2A7:FireShotgun2 SHT2B7 SHT2C7:CheckReload SHT2D7:OpenShotgun2 SHT2E7 SHT2F7:LoadShotgun2 "
       "SHT2G6 "
       "SHT2H6:CloseShotgun2 SHT2A5:ReFire SHT2A1:WeaponReady"},
      {"Chaingun", 2002, 4, 700, "Clip", 1, 20,
       "CHGGA4:FireCGun CHGGB4:FireCGun CHGGB0:ReFire CHGGA1:WeaponReady"},
      {"RocketLauncher", 2003, 5, 2500, "RocketAmmo", 1, 2,
       "MISGB8:GunFlash MISGB12:FireMissile MISGB0:ReFire"},
      {"PlasmaRifle", 2004, 6, 100, "Cell", 1, 40, "PLSGA3:FirePlasma PLSGB20:ReFire PLSGA1:WeaponReady"},
      {"BFG9000", 2006, 7, 2800, "Cell", 40, 40,
       "BFGGA20:BFGsound BFGGB10:GunFlash BFGGB10:FireBFG BFGGB20:ReFire"},
  };
  const ActorCatalog& catalog = builtin_catalog();
  for (const WeaponFacts& fact : facts) {
    SCOPED_TRACE(fact.name);
    const ActorType& type = catalog[*catalog.find(fact.name)];
    EXPECT_EQ(type.item_class, ItemClass::kWeapon);
    EXPECT_EQ(type.editor_number, fact.number);
    EXPECT_EQ(type.weapon.slot, fact.slot);
    EXPECT_EQ(type.weapon.selection_order, fact.selection_order);
    EXPECT_EQ(type.weapon.ammo_type, fact.ammo != nullptr ? *catalog.find(fact.ammo) : kNoType);
    EXPECT_EQ(type.weapon.ammo_use, fact.use);
    EXPECT_EQ(type.weapon.ammo_give, fact.give);
    const std::string fire = walk(catalog, type.state(StateLabel::kFire), 40);
    EXPECT_EQ(fire.rfind(fact.fire, 0), 0u) << fire;
    for (const StateLabel label : {StateLabel::kReady, StateLabel::kSelect, StateLabel::kDeselect})
      EXPECT_NE(type.state(label), kNoState);
  }
  EXPECT_EQ(catalog[*catalog.find("Chainsaw")].weapon.kickback, 0);
  EXPECT_EQ(catalog[*catalog.find("Shotgun")].weapon.kickback, 100);
}

struct ItemFacts {
  const char* name;
  int number, spawn_id;
  ItemClass kind;
  int amount, limit;
  bool counts, always;
};

TEST(Builtin, ItemsHaveDoomsNumbers) {
  using enum ItemClass;
  const ItemFacts facts[] = {
      {"HealthBonus", 2014, 152, kHealth, 1, 200, true, true},
      {"Stimpack", 2011, 23, kHealth, 10, 0, false, false},
      {"Medikit", 2012, 24, kHealth, 25, 0, false, false},
      {"Soulsphere", 2013, 25, kHealth, 100, 200, true, true},
      {"Megasphere", 83, 132, kCustomInventory, 1, 1, true, true},
      {"Berserk", 2023, 134, kCustomInventory, 1, 1, true, true},
      {"Clip", 2007, 11, kAmmo, 10, 200, false, false},
      {"ClipBox", 2048, 139, kAmmo, 50, 200, false, false},
      {"Shell", 2008, 12, kAmmo, 4, 50, false, false},
      {"ShellBox", 2049, 143, kAmmo, 20, 50, false, false},
      {"RocketAmmo", 2010, 140, kAmmo, 1, 50, false, false},
      {"RocketBox", 2046, 141, kAmmo, 5, 50, false, false},
      {"Cell", 2047, 75, kAmmo, 20, 300, false, false},
      {"CellPack", 17, 142, kAmmo, 100, 300, false, false},
      {"Backpack", 8, 144, kBackpack, 1, 1, false, true},
      {"InvulnerabilitySphere", 2022, 133, kPowerup, 1, 0, true, true},
      {"BlurSphere", 2024, 135, kPowerup, 1, 0, true, true},
      {"RadSuit", 2025, 136, kPowerup, 1, 0, false, true},
      {"Infrared", 2045, 138, kPowerup, 1, 0, true, true},
      {"Allmap", 2026, 137, kMap, 1, 0, true, true},
      {"RedCard", 13, 86, kKey, 1, 1, false, false},
      {"BlueCard", 5, 85, kKey, 1, 1, false, false},
      {"YellowCard", 6, 87, kKey, 1, 1, false, false},
      {"RedSkull", 38, 89, kKey, 1, 1, false, false},
      {"BlueSkull", 40, 90, kKey, 1, 1, false, false},
      {"YellowSkull", 39, 88, kKey, 1, 1, false, false},
  };
  const ActorCatalog& catalog = builtin_catalog();
  for (const ItemFacts& fact : facts) {
    SCOPED_TRACE(fact.name);
    const ActorType& type = catalog[*catalog.find(fact.name)];
    EXPECT_EQ(type.editor_number, fact.number);
    EXPECT_EQ(type.spawn_id, fact.spawn_id);
    EXPECT_EQ(type.item_class, fact.kind);
    EXPECT_EQ(type.amount, fact.amount);
    EXPECT_EQ(type.max_amount, fact.limit);
    EXPECT_EQ(type.flags.has(ActorFlag::kCountItem), fact.counts);
    EXPECT_EQ(type.flags.has(ActorFlag::kAlwaysPickup), fact.always);
    EXPECT_TRUE(type.flags.has(ActorFlag::kSpecial));
    EXPECT_EQ(type.radius, to_fixed(20));
    EXPECT_FALSE(type.flags.has(ActorFlag::kSolid));
  }
  const ActorType& green = catalog[*catalog.find("GreenArmor")];
  EXPECT_EQ(green.editor_number, 2018);
  EXPECT_EQ(green.save_amount, 100);
  EXPECT_NEAR(to_float(green.save_percent), 1.0 / 3, 1e-4);
  const ActorType& blue = catalog[*catalog.find("BlueArmor")];
  EXPECT_EQ(blue.editor_number, 2019);
  EXPECT_EQ(blue.save_amount, 200);
  EXPECT_EQ(blue.save_percent, kFracUnit / 2);
  const ActorType& bonus = catalog[*catalog.find("ArmorBonus")];
  EXPECT_EQ(bonus.editor_number, 2015);
  EXPECT_EQ(bonus.save_amount, 1);
  EXPECT_EQ(bonus.max_save_amount, 200);
  EXPECT_EQ(catalog[*catalog.find("ClipBox")].ammo_base, catalog.find("Clip"));
  EXPECT_EQ(catalog[*catalog.find("Clip")].backpack_max_amount, 400);
  EXPECT_EQ(catalog[*catalog.find("Cell")].backpack_max_amount, 600);
  EXPECT_EQ(catalog[*catalog.find("InvulnerabilitySphere")].power_tics, 30 * 35);
  EXPECT_EQ(catalog[*catalog.find("BlurSphere")].power_tics, 60 * 35);
  EXPECT_EQ(catalog[*catalog.find("RadSuit")].power_tics, 60 * 35);
  EXPECT_EQ(catalog[*catalog.find("Infrared")].power_tics, 120 * 35);
}

struct MissileFacts {
  const char* name;
  int spawn_id, radius, height, speed, fast_speed, damage;
};

TEST(Builtin, MissilesHaveDoomsNumbers) {
  const MissileFacts facts[] = {
      {"Rocket", 127, 11, 8, 20, -1, 20},
      {"PlasmaBall", 51, 13, 8, 25, -1, 5},
      {"BFGBall", 128, 13, 8, 25, -1, 100},
      {"DoomImpBall", 10, 6, 8, 10, 20, 3},
      {"CacodemonBall", 126, 6, 8, 10, 20, 5},
      {"BaronBall", 154, 6, 16, 15, 20, 8},
      {"FatShot", 153, 6, 8, 20, -1, 8},
      {"RevenantTracer", 53, 11, 8, 10, -1, 10},
      {"ArachnotronPlasma", 129, 13, 8, 25, -1, 5},
  };
  const ActorCatalog& catalog = builtin_catalog();
  for (const MissileFacts& fact : facts) {
    SCOPED_TRACE(fact.name);
    const ActorType& type = catalog[*catalog.find(fact.name)];
    EXPECT_EQ(type.spawn_id, fact.spawn_id);
    EXPECT_EQ(type.radius, to_fixed(fact.radius));
    EXPECT_EQ(type.height, to_fixed(fact.height));
    EXPECT_EQ(type.speed, to_fixed(fact.speed));
    EXPECT_EQ(type.fast_speed, fact.fast_speed < 0 ? -1 : to_fixed(fact.fast_speed));
    EXPECT_EQ(type.damage.factor, fact.damage);
    EXPECT_FALSE(type.damage.exact);
    for (const ActorFlag flag : {ActorFlag::kMissile, ActorFlag::kNoGravity, ActorFlag::kNoBlockmap,
                                 ActorFlag::kDropOff, ActorFlag::kNoTeleport, ActorFlag::kActivateImpact})
      EXPECT_TRUE(type.flags.has(flag));
  }
  EXPECT_TRUE(catalog[*catalog.find("RevenantTracer")].flags.has(ActorFlag::kSeekerMissile));
}

TEST(Builtin, PlayerIsDooms) {
  const ActorCatalog& catalog = builtin_catalog();
  const ActorType& player = catalog[*catalog.find("DoomPlayer")];
  EXPECT_TRUE(player.is_player);
  EXPECT_EQ(player.health, 100);
  EXPECT_EQ(player.mass, 100);
  EXPECT_EQ(player.radius, to_fixed(16));
  EXPECT_EQ(player.height, to_fixed(56));
  EXPECT_EQ(player.view_height, to_fixed(41));
  EXPECT_EQ(player.jump_speed, to_fixed(8));
  EXPECT_EQ(player.pain_chance, 255);
  ASSERT_EQ(player.start_items.size(), 3u);
  EXPECT_EQ(player.start_items[0].type, catalog.find("Pistol"));
  EXPECT_EQ(player.start_items[2].amount, 50);
}

struct SceneryFacts {
  const char* name;
  int number, radius, height;
  bool solid, hangs;
};

TEST(Builtin, SceneryHasDoomsBodies) {
  const SceneryFacts facts[] = {
      {"TallGreenColumn", 30, 16, 52, true, false}, {"Candlestick", 34, 20, 14, false, false},
      {"Candelabra", 35, 16, 60, true, false},      {"BlueTorch", 44, 16, 68, true, false},
      {"GreenTorch", 45, 16, 68, true, false},      {"RedTorch", 46, 16, 68, true, false},
      {"ShortBlueTorch", 55, 16, 37, true, false},  {"ShortRedTorch", 57, 16, 37, true, false},
      {"TechPillar", 48, 16, 128, true, false},     {"BigTree", 54, 32, 108, true, false},
      {"TechLamp", 85, 16, 80, true, false},        {"TechLamp2", 86, 16, 60, true, false},
      {"Column", 2028, 16, 48, true, false},        {"Meat2", 50, 16, 84, true, true},
      {"NonsolidMeat3", 61, 20, 84, false, true},   {"HangNoGuts", 73, 16, 88, true, true},
      {"BurningBarrel", 70, 16, 32, true, false},   {"ExplosiveBarrel", 2035, 10, 42, true, false},
      {"FloatingSkull", 42, 16, 26, true, false},   {"Stalagtite", 47, 16, 40, true, false},
  };
  const ActorCatalog& catalog = builtin_catalog();
  for (const SceneryFacts& fact : facts) {
    SCOPED_TRACE(fact.name);
    const ActorType& type = catalog[*catalog.find(fact.name)];
    EXPECT_EQ(type.editor_number, fact.number);
    EXPECT_EQ(type.radius, to_fixed(fact.radius));
    EXPECT_EQ(type.height, to_fixed(fact.height));
    EXPECT_EQ(type.flags.has(ActorFlag::kSolid), fact.solid);
    EXPECT_EQ(type.flags.has(ActorFlag::kSpawnCeiling), fact.hangs);
  }
  const ActorType& barrel = catalog[*catalog.find("ExplosiveBarrel")];
  EXPECT_EQ(barrel.health, 20);
  EXPECT_TRUE(barrel.flags.has(ActorFlag::kShootable));
}

TEST(Builtin, MarinesAndMarkersAreThere) {
  const ActorCatalog& catalog = builtin_catalog();
  const std::pair<const char*, int> marines[] = {
      {"ScriptedMarine", 9100}, {"MarineFist", 9101},    {"MarineBerserk", 9102}, {"MarineChainsaw", 9103},
      {"MarinePistol", 9104},   {"MarineShotgun", 9105}, {"MarineSSG", 9106},     {"MarineChaingun", 9107},
      {"MarineRocket", 9108},   {"MarinePlasma", 9109},  {"MarineRailgun", 9110}, {"MarineBFG", 9111}};
  for (const auto& [name, number] : marines) {
    SCOPED_TRACE(name);
    const ActorType& type = catalog[*catalog.find(name)];
    EXPECT_EQ(type.editor_number, number);
    EXPECT_EQ(type.health, 100);
    EXPECT_EQ(type.pain_chance, 160);
    EXPECT_TRUE(type.flags.has(ActorFlag::kIsMonster));
    EXPECT_FALSE(type.flags.has(ActorFlag::kCountKill));
    EXPECT_TRUE(catalog.is_a(*catalog.find(name), "ScriptedMarine"));
  }
  const std::pair<const char*, int> markers[] = {{"TeleportDest", 14},
                                                 {"MapSpot", 9001},
                                                 {"MapSpotGravity", 9013},
                                                 {"PatrolPoint", 9024},
                                                 {"PatrolSpecial", 9047},
                                                 {"DeathmatchStart", 11},
                                                 {"Player1Start", 1},
                                                 {"Player8Start", 4004},
                                                 {"InvisibleBridge", 9990},
                                                 {"InvisibleBridge32", 5061},
                                                 {"InvisibleBridge16", 5064},
                                                 {"InvisibleBridge8", 5065},
                                                 {"ZBridge", 118},
                                                 {"SecActEnter", 9998},
                                                 {"SecretTrigger", 9046},
                                                 {"SectorSilencer", 9082}};
  for (const auto& [name, number] : markers) {
    SCOPED_TRACE(name);
    ASSERT_TRUE(catalog.find(name).has_value());
    EXPECT_EQ(catalog.find_editor_number(number), catalog.find(name));
    EXPECT_FALSE(catalog[*catalog.find(name)].flags.has(ActorFlag::kShootable));
  }
  EXPECT_TRUE(catalog[*catalog.find("InvisibleBridge16")].flags.has(ActorFlag::kSolid));
  EXPECT_EQ(catalog[*catalog.find("InvisibleBridge16")].radius, to_fixed(16));
}

TEST(Builtin, NoTwoHaveTheSameNumber) {
  const ActorCatalog& catalog = builtin_catalog();
  std::set<int32_t> editor_numbers, spawn_ids;
  for (uint32_t index = 0; index < catalog.size(); ++index) {
    const ActorType& type = catalog[index];
    EXPECT_TRUE(type.editor_number < 0 || editor_numbers.insert(type.editor_number).second) << type.name;
    EXPECT_TRUE(type.spawn_id <= 0 || spawn_ids.insert(type.spawn_id).second) << type.name;
  }
  EXPECT_GT(editor_numbers.size(), 180u);
}

TEST(Builtin, EveryStateLeadsToOneThatExists) {
  const ActorCatalog& catalog = builtin_catalog();
  for (uint32_t place = 0; place < catalog.state_count(); ++place) {
    const State& state = catalog.state(place);
    EXPECT_TRUE(state.next == kNoState || state.next < catalog.state_count());
    EXPECT_LT(state.sprite, catalog.sprite_count());
    EXPECT_LE(state.first_arg + state.arg_count, state.first_arg + catalog.args(state).size());
  }
}

TEST(Builtin, ActorsOfNoTicsDoNotLoopForEver) {
  // A circle of states of no tics would hang the tic in which an actor comes into it.
  const ActorCatalog& catalog = builtin_catalog();
  for (uint32_t index = 0; index < catalog.size(); ++index)
    for (const ActorType::Label& label : catalog[index].labels) {
      uint32_t place = label.state;
      int steps = 0;
      while (place != kNoState && catalog.state(place).tics == 0 && steps < 100)
        place = catalog.state(place).next, ++steps;
      EXPECT_LT(steps, 100) << catalog[index].name << " " << label.name;
    }
}

}  // namespace builtin_test
}  // namespace comrad::doom::test
