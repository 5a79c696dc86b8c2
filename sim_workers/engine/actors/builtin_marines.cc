// ZDoom's scripted marines: monsters in the player's clothes, one per weapon.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

struct Marine {
  const char* name;
  int32_t number;
  const char* program;
};

}  // namespace

void add_marines(ActorCatalog* catalog) {
  ActorType marine = start_type(*catalog, "Actor", "ScriptedMarine", 9100, 151);
  marine.health = 100, marine.radius = to_fixed(16), marine.height = to_fixed(56), marine.mass = 100;
  marine.speed = to_fixed(8), marine.pain_chance = 160;
  marine.damage.factor = 100;
  set_flags(&marine, {kSolid, kShootable, kIsMonster, kCanPass, kCanUseWalls, kPushWall, kActivateCross});
  // Labels with a weapon's name lead to its attack; a marine has those of its weapon as Melee or Missile.
  // After M_Refire and M_SawRefire the row behind the link is where they go when the fight is over.
  add_type(
      catalog, std::move(marine),
      "Spawn: PLAY A 4 MarineLook; A 4 MarineNoise; again;"
      "Idle: A 4 MarineLook; A 4 MarineNoise; A 4 MarineLook; B 4 MarineNoise; B 4 MarineLook;"
      "B 4 MarineNoise; again;"
      "See: ABCD 4 MarineChase; again;"
      "Melee.Fist: E 4 FaceTarget; E 4 M_Punch(1); A 9; A 0 M_Refire(1); again; A 5 FaceTarget; to See;"
      "Melee.Berserk: E 4 FaceTarget; E 4 M_Punch(10); A 9; A 0 M_Refire(1); again; A 5 FaceTarget; to See;"
      "Melee.Chainsaw: E 4 MarineNoise; E 4 M_Saw; E 0 M_SawRefire; to Melee.Chainsaw+1; A 0; to See;"
      "Missile: Missile.None: E 12 FaceTarget; to Idle; F 6*; to Missile.None;"
      "Missile.Pistol: E 4 FaceTarget; F 6* M_FirePistol(1); A 4 FaceTarget; A 0 M_Refire;"
      "to Fireloop.Pistol; A 5; to See;"
      "Fireloop.Pistol: F 6* M_FirePistol(0); A 4 FaceTarget; A 0 M_Refire; again; A 5; to See;"
      "Missile.Shotgun: E 3 M_CheckAttack; F 7* M_FireShotgun; to See; SkipAttack: A 3; to See;"
      "Missile.SSG: E 3 M_CheckAttack; F 7* M_FireShotgun2; to See;"
      "Missile.Chaingun: E 4 FaceTarget; FF 4* M_FireCGun(1);"
      "Fireloop.Chaingun: FF 4* M_FireCGun(0); A 0 M_Refire; again; A 0; to See;"
      "Missile.Rocket: E 8; F 6* M_FireMissile; E 6; A 0 M_Refire; again; A 0; to See;"
      "Missile.Railgun: E 4 M_CheckAttack; F 6* M_FireRailgun; to See;"
      "Missile.Plasma: E 2 FaceTarget; E 0 FaceTarget; F 3* M_FirePlasma; A 0 M_Refire;"
      "to Missile.Plasma+1; A 0; to See;"
      "Missile.BFG: E 5; EEEEE 5 FaceTarget; F 6* M_FireBFG; A 4 FaceTarget; A 0 M_Refire; again; A 0; to "
      "See;"
      "Pain: G 4; G 4 Pain; to Idle;"
      "Death: H 10; I 10 Scream; J 10 NoBlocking; KLM 10; N -1; gone;"
      "XDeath: O 5; P 5 XScream; Q 5 NoBlocking; RSTUV 5; W -1; gone;"
      "Raise: MLKJIH 5; to See");

  // clang-format off
  const Marine marines[] = {
      {"MarineFist", 9101, "Melee: to Melee.Fist; Missile: gone"},
      {"MarineBerserk", 9102, "Melee: to Melee.Berserk; Missile: gone"},
      {"MarineChainsaw", 9103, "Melee: to Melee.Chainsaw; Missile: gone"},
      {"MarinePistol", 9104, "Missile: to Missile.Pistol"},
      {"MarineShotgun", 9105, "Missile: to Missile.Shotgun"},
      {"MarineSSG", 9106, "Missile: to Missile.SSG"},
      {"MarineChaingun", 9107, "Missile: to Missile.Chaingun"},
      {"MarineRocket", 9108, "Melee: to Melee.Fist; Missile: to Missile.Rocket"},
      {"MarinePlasma", 9109, "Missile: to Missile.Plasma"},
      {"MarineRailgun", 9110, "Missile: to Missile.Railgun"},
      {"MarineBFG", 9111, "Missile: to Missile.BFG"},
  };
  // clang-format on
  for (const Marine& row : marines)
    add_type(catalog, start_type(*catalog, "ScriptedMarine", row.name, row.number), row.program);
}

}  // namespace comrad::doom
