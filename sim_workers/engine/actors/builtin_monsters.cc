// Doom II's monsters.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

struct Monster {
  const char* name;
  const char* parent;
  int32_t number, spawn_id;
  int32_t health;
  int radius, height, mass, speed, pain_chance;
  const char* drop;  ///< null: nothing
  FlagList flags;
  const char* program;
};

constexpr const char* kBaronProgram =
    "Spawn: BOSS AB 10 Look; again; See: AABBCCDD 3 Chase; again;"
    "Melee: Missile: EF 8 FaceTarget; G 8 BruisAttack; to See; Pain: H 2; H 2 Pain; to See;"
    "Death: I 8; J 8 Scream; K 8; L 8 NoBlocking; MN 8; O -1 BossDeath; gone;"
    "Raise: ONMLKJI 8; to See";

constexpr const char* kKnightProgram =
    "Spawn: BOS2 AB 10 Look; again; See: AABBCCDD 3 Chase; again;"
    "Melee: Missile: EF 8 FaceTarget; G 8 BruisAttack; to See; Pain: H 2; H 2 Pain; to See;"
    "Death: I 8; J 8 Scream; K 8; L 8 NoBlocking; MN 8; O -1; gone;"
    "Raise: ONMLKJI 8; to See";

}  // namespace

void add_monsters(ActorCatalog* catalog) {
  // clang-format off
  const Monster monsters[] = {
      {"ZombieMan", "Actor", 3004, 4, 20, 20, 56, 100, 8, 200, "Clip", {kFloorClip},
       "Spawn: POSS AB 10 Look; again; See: AABBCCDD 4 Chase; again;"
       "Missile: E 10 FaceTarget; F 8 PosAttack; E 8; to See; Pain: G 3; G 3 Pain; to See;"
       "Death: H 5; I 5 Scream; J 5 NoBlocking; K 5; L -1; gone;"
       "XDeath: M 5; N 5 XScream; O 5 NoBlocking; PQRST 5; U -1; gone; Raise: KJIH 5; to See"},
      {"ShotgunGuy", "Actor", 9, 1, 30, 20, 56, 100, 8, 170, "Shotgun", {kFloorClip},
       "Spawn: SPOS AB 10 Look; again; See: AABBCCDD 3 Chase; again;"
       "Missile: E 10 FaceTarget; F 10* SPosAttackUseAtkSound; E 10; to See; Pain: G 3; G 3 Pain; to See;"
       "Death: H 5; I 5 Scream; J 5 NoBlocking; K 5; L -1; gone;"
       "XDeath: M 5; N 5 XScream; O 5 NoBlocking; PQRST 5; U -1; gone; Raise: LKJIH 5; to See"},
      {"ChaingunGuy", "Actor", 65, 2, 70, 20, 56, 100, 8, 170, "Chaingun", {kFloorClip},
       "Spawn: CPOS AB 10 Look; again; See: AABBCCDD 3 Chase; again;"
       "Missile: E 10 FaceTarget; FE 4* CPosAttack; F 1 CPosRefire; to Missile+1;"
       "Pain: G 3; G 3 Pain; to See;"
       "Death: H 5; I 5 Scream; J 5 NoBlocking; KLM 5; N -1; gone;"
       "XDeath: O 5; P 5 XScream; Q 5 NoBlocking; RS 5; T -1; gone; Raise: NMLKJIH 5; to See"},
      {"WolfensteinSS", "Actor", 84, 116, 50, 20, 56, 100, 8, 170, "Clip", {kFloorClip},
       "Spawn: SSWV AB 10 Look; again; See: AABBCCDD 3 Chase; again;"
       "Missile: EF 10 FaceTarget; G 4* CPosAttack; F 6 FaceTarget; G 4* CPosAttack; F 1 CPosRefire;"
       "to Missile+1; Pain: H 3; H 3 Pain; to See;"
       "Death: I 5; J 5 Scream; K 5 NoBlocking; L 5; M -1; gone;"
       "XDeath: N 5; O 5 XScream; P 5 NoBlocking; QRSTU 5; V -1; gone; Raise: MLKJI 5; to See"},
      {"DoomImp", "Actor", 3001, 5, 60, 20, 56, 100, 8, 200, nullptr, {kFloorClip},
       "Spawn: TROO AB 10 Look; again; See: AABBCCDD 3 Chase; again;"
       "Melee: Missile: EF 8 FaceTarget; G 6 TroopAttack; to See; Pain: H 2; H 2 Pain; to See;"
       "Death: I 8; J 8 Scream; K 6; L 6 NoBlocking; M -1; gone;"
       "XDeath: N 5; O 5 XScream; P 5; Q 5 NoBlocking; RST 5; U -1; gone; Raise: ML 8; KJI 6; to See"},
      {"Demon", "Actor", 3002, 8, 150, 30, 56, 400, 10, 180, nullptr, {kFloorClip},
       "Spawn: SARG AB 10 Look; again; See: AABBCCDD 2f Chase; again;"
       "Melee: EF 8f FaceTarget; G 8f SargAttack; to See; Pain: H 2f; H 2f Pain; to See;"
       "Death: I 8; J 8 Scream; K 4; L 4 NoBlocking; M 4; N -1; gone; Raise: NMLKJI 5; to See"},
      {"Spectre", "Demon", 58, 9, 150, 30, 56, 400, 10, 180, nullptr, {kFloorClip, kShadow}, ""},
      {"LostSoul", "Actor", 3006, 110, 100, 16, 56, 50, 8, 256, nullptr,
       {kFloat, kNoGravity, kMissileMore, kDontFall, kNoIceDeath},
       "Spawn: SKUL AB 10* Look; again; See: AB 6* Chase; again;"
       "Missile: C 10* FaceTarget; D 4* SkullAttack; CD 4*; to Missile+2;"
       "Pain: E 3*; E 3* Pain; to See;"
       "Death: F 6*; G 6* Scream; H 6*; I 6* NoBlocking; J 6; K 6; gone"},
      {"Cacodemon", "Actor", 3005, 19, 400, 31, 56, 400, 8, 128, nullptr, {kFloat, kNoGravity},
       "Spawn: HEAD A 10 Look; again; See: A 3 Chase; again;"
       "Missile: BC 5 FaceTarget; D 5* HeadAttack; to See; Pain: E 3; E 3 Pain; F 6; to See;"
       "Death: G 8; H 8 Scream; IJ 8; K 8 NoBlocking; L -1; gone;"
       "Raise: L 8 UnsetFloorClip; KJIHG 8; to See"},
      {"PainElemental", "Actor", 71, 115, 400, 31, 56, 400, 8, 128, nullptr, {kFloat, kNoGravity},
       "Spawn: PAIN A 10 Look; again; See: AABBCC 3 Chase; again;"
       "Missile: DE 5 FaceTarget; F 5* FaceTarget; F 0* PainAttack; to See; Pain: G 6; G 6 Pain; to See;"
       "Death: H 8*; I 8* Scream; JK 8*; L 8* PainDie; M 8*; gone; Raise: MLKJIH 8; to See"},
      {"BaronOfHell", "Actor", 3003, 3, 1000, 24, 64, 1000, 8, 50, nullptr, {kFloorClip, kBossDeath},
       kBaronProgram},
      {"HellKnight", "BaronOfHell", 69, 113, 500, 24, 64, 1000, 8, 50, nullptr, {}, kKnightProgram},
      {"Revenant", "Actor", 66, 20, 300, 20, 56, 500, 10, 100, nullptr, {kFloorClip, kMissileMore},
       "Spawn: SKEL AB 10 Look; again; See: AABBCCDDEEFF 2 Chase; again;"
       "Melee: G 0 FaceTarget; G 6 SkelWhoosh; H 6 FaceTarget; I 6 SkelFist; to See;"
       "Missile: J 0* FaceTarget; J 10* FaceTarget; K 10 SkelMissile; K 10 FaceTarget; to See;"
       "Pain: L 5; L 5 Pain; to See;"
       "Death: LM 7; N 7 Scream; O 7 NoBlocking; P 7; Q -1; gone; Raise: QPONML 5; to See"},
      {"Fatso", "Actor", 67, 112, 600, 48, 64, 1000, 8, 80, nullptr, {kFloorClip, kBossDeath},
       "Spawn: FATT AB 15 Look; again; See: AABBCCDDEEFF 4 Chase; again;"
       "Missile: G 20 FatRaise; H 10* FatAttack1; IG 5 FaceTarget; H 10* FatAttack2; IG 5 FaceTarget;"
       "H 10* FatAttack3; IG 5 FaceTarget; to See; Pain: J 3; J 3 Pain; to See;"
       "Death: K 6; L 6 Scream; M 6 NoBlocking; NOPQRS 6; T -1 BossDeath; gone; Raise: RQPONMLK 5; to See"},
      {"Arachnotron", "Actor", 68, 6, 500, 64, 64, 600, 12, 128, nullptr, {kFloorClip, kBossDeath},
       "Spawn: BSPI AB 10 Look; again;"
       "See: A 20; A 3 BabyMetal; ABBCC 3 Chase; D 3 BabyMetal; DEEFF 3 Chase; to See+1;"
       "Missile: A 20* FaceTarget; G 4* BspiAttack; H 4*; H 1* SpidRefire; to Missile+1;"
       "Pain: I 3; I 3 Pain; to See+1;"
       "Death: J 20 Scream; K 7 NoBlocking; LMNO 7; P -1 BossDeath; gone; Raise: PONMLKJ 5; to See+1"},
      {"SpiderMastermind", "Actor", 7, 7, 3000, 128, 100, 1000, 12, 40, nullptr,
       {kFloorClip, kBoss, kBossDeath, kMissileMore, kNoRadiusDamage, kDontMorph},
       "Spawn: SPID AB 10 Look; again;"
       "See: A 3 Metal; ABB 3 Chase; C 3 Metal; CDD 3 Chase; E 3 Metal; EFF 3 Chase; again;"
       "Missile: A 20* FaceTarget; G 4* SPosAttackUseAtkSound; H 4* SPosAttackUseAtkSound;"
       "H 1* SpidRefire; to Missile+1; Pain: I 3; I 3 Pain; to See;"
       "Death: J 20 Scream; K 10 NoBlocking; LMNOPQR 10; S 30; S -1 BossDeath; gone"},
      {"Cyberdemon", "Actor", 16, 114, 4000, 40, 110, 1000, 16, 20, nullptr,
       {kFloorClip, kBoss, kBossDeath, kMissileMore, kNoRadiusDamage, kDontMorph},
       "Spawn: CYBR AB 10 Look; again; See: A 3 Hoof; ABBCC 3 Chase; D 3 Metal; D 3 Chase; again;"
       "Missile: E 6 FaceTarget; F 12 CyberAttack; E 12 FaceTarget; F 12 CyberAttack; E 12 FaceTarget;"
       "F 12 CyberAttack; to See; Pain: G 10 Pain; to See;"
       "Death: H 10; I 10 Scream; JKL 10; M 10 NoBlocking; NO 10; P 30; P -1 BossDeath; gone"},
      {"Archvile", "Actor", 64, 111, 700, 20, 56, 500, 15, 10, nullptr,
       {kFloorClip, kQuickToRetaliate, kNoTarget},
       "Spawn: VILE AB 10 Look; again; See: AABBCCDDEEFF 2 VileChase; again;"
       "Missile: G 0* VileStart; G 10* FaceTarget; H 8* VileTarget; IJKLMN 8* FaceTarget;"
       "O 8* VileAttack; P 20*; to See; Heal: [\\] 10*; to See; Pain: Q 5; Q 5 Pain; to See;"
       "Death: Q 7; R 7 Scream; S 7 NoBlocking; TUVW 7; XY 5; Z -1; gone"},
      {"CommanderKeen", "Actor", 72, 0, 100, 16, 72, 10000000, 0, 256, nullptr,
       {kSpawnCeiling, kNoGravity, kNoIceDeath},
       "Spawn: KEEN A -1; stay;"
       "Death: AB 6; C 6 Scream; DEFGHIJ 6; K 6 KeenDie; L -1; gone; Pain: M 4; M 8 Pain; to Spawn"},
      {"BossBrain", "Actor", 88, 0, 250, 20, 16, 10000000, 0, 255, nullptr, {kNoIceDeath},
       "Spawn: BBRN A -1; stay; Pain: B 36 BrainPain; to Spawn;"
       "Death: A 100 BrainScream; AA 10; A -1 BrainDie; gone"},
  };
  // clang-format on
  for (const Monster& row : monsters) {
    ActorType type = start_type(*catalog, row.parent, row.name, row.number, row.spawn_id);
    set_flags(&type, {kSolid, kShootable, kCountKill, kIsMonster, kCanPass, kCanUseWalls, kPushWall,
                      kActivateCross});
    set_flags(&type, row.flags);
    type.health = row.health, type.mass = row.mass, type.pain_chance = row.pain_chance;
    type.radius = to_fixed(row.radius), type.height = to_fixed(row.height), type.speed = to_fixed(row.speed);
    if (row.drop != nullptr) type.drop_items = {{.type = type_index(*catalog, row.drop)}};
    const std::string_view name = row.name;
    if (name == "LostSoul") type.damage.factor = 3;
    if (name == "HellKnight") type.flags.set(kBossDeath, false);
    if (name == "Spectre") type.render_style = RenderStyle::kFuzzy, type.alpha = 0.5f;
    if (name == "Revenant") type.melee_threshold = to_fixed(196);
    if (name == "Archvile") type.max_target_range = to_fixed(896);
    if (name == "Cyberdemon" || name == "SpiderMastermind") type.min_missile_chance = 160;
    if (name == "BossBrain")
      set_flags(&type, {kIsMonster, kCountKill, kCanPass, kCanUseWalls, kPushWall, kActivateCross}, false);
    if (name == "CommanderKeen") set_flags(&type, {kCanPass, kCanUseWalls, kPushWall, kActivateCross}, false);
    add_type(catalog, std::move(type), row.program);
  }
  ActorType eye = start_type(*catalog, "Actor", "BossEye", 89);
  eye.height = to_fixed(32);
  set_flags(&eye, {kNoBlockmap, kNoSector});
  add_type(catalog, std::move(eye),
           "Spawn: SSWV A 10 Look; again; See: A 181 BrainAwake; A 150 BrainSpit; stay");
  ActorType target = start_type(*catalog, "Actor", "BossTarget", 87);
  target.height = to_fixed(32);
  set_flags(&target, {kNoBlockmap, kNoSector});
  add_type(catalog, std::move(target), "");
}

}  // namespace comrad::doom
