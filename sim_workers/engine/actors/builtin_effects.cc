// What flies, puffs, bleeds and explodes.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

struct Missile {
  const char* name;
  int32_t number, spawn_id;
  int radius, height, speed, fast_speed, damage;
  RenderStyle style;
  float alpha;
  FlagList flags;
  const char* program;
};

struct Effect {
  const char* name;
  int32_t spawn_id;
  RenderStyle style;
  float alpha;
  const char* program;
};

}  // namespace

void add_effects(ActorCatalog* catalog) {
  // clang-format off
  const Effect effects[] = {
      {"BulletPuff", 131, RenderStyle::kTranslucent, 0.5f, "Spawn: PUFF A 4*; B 4; Melee: CD 4; gone"},
      {"Blood", 130, RenderStyle::kNormal, 1.0f, "Spawn: BLUD CBA 8; gone"},
      {"TeleportFog", 0, RenderStyle::kAdd, 1.0f, "Spawn: TFOG ABABCDEFGHIJ 6*; gone"},
      {"ItemFog", 0, RenderStyle::kNormal, 1.0f, "Spawn: IFOG ABABCDE 6*; gone"},
      {"RevenantTracerSmoke", 0, RenderStyle::kTranslucent, 0.5f, "Spawn: PUFF ABABC 4; gone"},
      {"RocketSmokeTrail", 0, RenderStyle::kTranslucent, 0.5f, "Spawn: PUFF ABABC 4; gone"},
      {"SpawnFire", 0, RenderStyle::kAdd, 1.0f, "Spawn: FIRE ABCDEFGH 4* Fire; gone"},
      {"BFGExtra", 0, RenderStyle::kAdd, 0.75f, "Spawn: BFE2 ABCD 8*; gone"},
      {"ArchvileFire", 98, RenderStyle::kAdd, 1.0f,
       "Spawn: FIRE A 2* StartFire; BAB 2* Fire; C 2* FireCrackle; BCBCDCDCDEDED 2* Fire;"
       "E 2* FireCrackle; FEFEFGHGHGH 2* Fire; gone"},
      {"RealGibs", 0, RenderStyle::kNormal, 1.0f, "Spawn: POL5 A -1; gone"},
  };
  // clang-format on
  for (const Effect& row : effects) {
    ActorType type = start_type(*catalog, "Actor", row.name, -1, row.spawn_id);
    set_flags(&type, {kNoBlockmap, kNoGravity});
    type.render_style = row.style, type.alpha = row.alpha;
    const std::string_view name = row.name;
    if (name == "Blood") {
      set_flags(&type, {kNoGravity}, false);
      set_flags(&type, {kNoTeleport});
      type.mass = 5;
    }
    if (name == "BulletPuff") type.mass = 5, set_flags(&type, {kRandomize});
    if (name == "TeleportFog" || name == "RevenantTracerSmoke" || name == "RocketSmokeTrail")
      set_flags(&type, {kNoTeleport});
    if (name == "RealGibs")
      set_flags(&type, {kNoGravity, kNoBlockmap}, false),
          set_flags(&type, {kDropOff, kCorpse, kNoTeleport, kDontGib});
    if (name == "SpawnFire") type.height = to_fixed(78);
    if (name == "BFGExtra") type.damage_type = DamageType::kNormal;
    add_type(catalog, std::move(type), row.program);
  }
  add_type(catalog, start_type(*catalog, "BulletPuff", "PlasmaPuff"), "");

  constexpr const char* kRocket =
      "Spawn: MISL A 1*; again; Death: B 8* Explode; C 6*; D 4*; gone;"
      "BrainExplode: BC 10*; D 10* BrainExplode; gone";
  // clang-format off
  const Missile missiles[] = {
      {"Rocket", -1, 127, 11, 8, 20, 0, 20, RenderStyle::kNormal, 1.0f, {kRandomize, kRocketTrail}, kRocket},
      {"PlasmaBall", -1, 51, 13, 8, 25, 0, 5, RenderStyle::kAdd, 0.75f, {kRandomize},
       "Spawn: PLSS AB 6*; again; Death: PLSE ABCDE 4*; gone"},
      {"BFGBall", -1, 128, 13, 8, 25, 0, 100, RenderStyle::kAdd, 0.75f, {kRandomize},
       "Spawn: BFS1 AB 4*; again; Death: BFE1 AB 8*; C 8* BFGSpray; DEF 8*; gone"},
      {"DoomImpBall", -1, 10, 6, 8, 10, 20, 3, RenderStyle::kAdd, 1.0f, {kRandomize},
       "Spawn: BAL1 AB 4*; again; Death: CDE 6*; gone"},
      {"CacodemonBall", -1, 126, 6, 8, 10, 20, 5, RenderStyle::kAdd, 1.0f, {kRandomize},
       "Spawn: BAL2 AB 4*; again; Death: CDE 6*; gone"},
      {"BaronBall", -1, 154, 6, 16, 15, 20, 8, RenderStyle::kAdd, 1.0f, {kRandomize},
       "Spawn: BAL7 AB 4*; again; Death: CDE 6*; gone"},
      {"FatShot", -1, 153, 6, 8, 20, 0, 8, RenderStyle::kAdd, 1.0f, {kRandomize},
       "Spawn: MANF AB 4*; again; Death: MISL B 8*; C 6*; D 4*; gone"},
      {"RevenantTracer", -1, 53, 11, 8, 10, 0, 10, RenderStyle::kAdd, 1.0f, {kRandomize, kSeekerMissile},
       "Spawn: FATB AB 2* Tracer; again; Death: FBXP A 8*; B 6*; C 4*; gone"},
      {"ArachnotronPlasma", -1, 129, 13, 8, 25, 0, 5, RenderStyle::kAdd, 0.75f, {kRandomize},
       "Spawn: APLS AB 5*; again; Death: APBX ABCDE 5*; gone"},
      {"SpawnShot", -1, 0, 6, 32, 10, 0, 3, RenderStyle::kNormal, 1.0f, {kNoClip, kRandomize},
       "Spawn: BOSF A 3* SpawnSound; BCD 3* SpawnFly; again"},
  };
  // clang-format on
  for (const Missile& row : missiles) {
    ActorType type = start_type(*catalog, "Actor", row.name, row.number, row.spawn_id);
    set_flags(&type,
              {kNoBlockmap, kNoGravity, kDropOff, kMissile, kNoTeleport, kActivateImpact, kActivateCross});
    set_flags(&type, row.flags);
    if (std::string_view(row.name) == "SpawnShot") type.flags.set(kActivateCross, false);
    type.radius = to_fixed(row.radius), type.height = to_fixed(row.height);
    type.speed = to_fixed(row.speed);
    if (row.fast_speed > 0) type.fast_speed = to_fixed(row.fast_speed);
    type.damage.factor = row.damage;
    type.render_style = row.style, type.alpha = row.alpha;
    add_type(catalog, std::move(type), row.program);
  }
}

}  // namespace comrad::doom
