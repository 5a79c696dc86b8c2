// Doom II's weapons: what they cost, and what the hand shows tic by tic.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

struct Weapon {
  const char* name;
  int32_t number, spawn_id;
  int32_t slot, priority, selection_order;
  const char* ammo;  ///< null: needs none
  int32_t ammo_use, ammo_give;
  FlagList flags;
  const char* program;
};

}  // namespace

void add_weapons(ActorCatalog* catalog) {
  // clang-format off
  const Weapon weapons[] = {
      {"Fist", -1, 0, 1, 0, 3700, nullptr, 0, 0, {kWeaponWimpy, kWeaponMelee},
       "Ready: PUNG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: B 4; C 4 Punch; D 5; C 4; B 5 ReFire; to Ready"},
      {"Chainsaw", 2005, 32, 1, 0, 2200, nullptr, 0, 0, {kWeaponMelee},
       "Ready: SAWG CD 4 WeaponReady; again; Deselect: C 1 Lower; again; Select: C 1 Raise; again;"
       "Fire: AB 4 Saw; B 0 ReFire; to Ready; Spawn: CSAW A -1; gone"},
      {"Pistol", -1, 0, 2, 0, 1900, "Clip", 1, 20, {kWeaponWimpy},
       "Ready: PISG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: A 4; B 6 FirePistol; C 4; B 5 ReFire; to Ready;"
       "Flash: PISF A 7* Light1; to LightDone; A 7* Light1; to LightDone; Spawn: PIST A -1; gone"},
      {"Shotgun", 2001, 27, 3, 0, 1300, "Shell", 1, 8, {},
       "Ready: SHTG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: A 3; A 7 FireShotgun; BC 5; D 4; CB 5; A 3; A 7 ReFire; to Ready;"
       "Flash: SHTF A 4* Light1; B 3* Light2; to LightDone; Spawn: SHOT A -1; gone"},
      {"SuperShotgun", 82, 33, 3, 0, 400, "Shell", 2, 8, {},
       "Ready: SHT2 A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: A 3; A 7 FireShotgun2; B 7; C 7 CheckReload; D 7 OpenShotgun2; E 7; F 7 LoadShotgun2; G 6;"
       "H 6 CloseShotgun2; A 5 ReFire; to Ready; B 7; A 3; to Deselect;"
       "Flash: I 4* Light1; J 3* Light2; to LightDone; Spawn: SGN2 A -1; gone"},
      {"Chaingun", 2002, 28, 4, 0, 700, "Clip", 1, 20, {},
       "Ready: CHGG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: AB 4 FireCGun; B 0 ReFire; to Ready;"
       "Flash: CHGF A 5* Light1; to LightDone; B 5* Light2; to LightDone; Spawn: MGUN A -1; gone"},
      {"RocketLauncher", 2003, 29, 5, 0, 2500, "RocketAmmo", 1, 2, {kWeaponNoAutoFire, kWeaponExplosive},
       "Ready: MISG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: B 8 GunFlash; B 12 FireMissile; B 0 ReFire; to Ready;"
       "Flash: MISF A 3* Light1; B 4*; CD 4* Light2; to LightDone; Spawn: LAUN A -1; gone"},
      {"PlasmaRifle", 2004, 30, 6, 0, 100, "Cell", 1, 40, {},
       "Ready: PLSG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: A 3 FirePlasma; B 20 ReFire; to Ready;"
       "Flash: PLSF A 4* Light1; to LightDone; B 4* Light1; to LightDone; Spawn: PLAS A -1; gone"},
      {"BFG9000", 2006, 31, 7, 0, 2800, "Cell", 40, 40, {kWeaponNoAutoFire},
       "Ready: BFGG A 1 WeaponReady; again; Deselect: A 1 Lower; again; Select: A 1 Raise; again;"
       "Fire: A 20 BFGsound; B 10 GunFlash; B 10 FireBFG; B 20 ReFire; to Ready;"
       "Flash: BFGF A 11* Light1; B 6* Light2; to LightDone; Spawn: BFUG A -1; gone"},
  };
  // clang-format on
  for (const Weapon& row : weapons) {
    ActorType type = start_type(*catalog, "DoomWeapon", row.name, row.number, row.spawn_id);
    set_flags(&type, row.flags);
    WeaponInfo& weapon = type.weapon;
    weapon.slot = row.slot, weapon.slot_priority = row.priority, weapon.slot_of_player = true;
    weapon.selection_order = row.selection_order;
    if (row.ammo != nullptr) weapon.ammo_type = type_index(*catalog, row.ammo);
    weapon.ammo_use = row.ammo_use, weapon.ammo_give = row.ammo_give;
    if (std::string_view(row.name) == "Chainsaw") weapon.kickback = 0;
    if (std::string_view(row.name) == "BFG9000") type.height = to_fixed(20);
    add_type(catalog, std::move(type), row.program);
  }
  add_custom_items(catalog);
}

void add_players(ActorCatalog* catalog) {
  ActorType player = start_type(*catalog, "PlayerPawn", "DoomPlayer");
  // The pistol comes first: it is the one in the hand.
  player.start_items = {{.type = type_index(*catalog, "Pistol"), .amount = 1},
                        {.type = type_index(*catalog, "Fist"), .amount = 1},
                        {.type = type_index(*catalog, "Clip"), .amount = 50}};
  add_type(catalog, std::move(player),
           "Spawn: PLAY A -1; again; See: ABCD 4; again; Missile: E 12; to Spawn; Melee: F 6*; to Missile;"
           "Pain: G 4; G 4 Pain; to Spawn;"
           "Death: H 10; I 10 PlayerScream; J 10 NoBlocking; KLM 10; N -1; gone;"
           "XDeath: O 5; P 5 XScream; Q 5 NoBlocking; RSTUV 5; W -1; gone");
}

}  // namespace comrad::doom
