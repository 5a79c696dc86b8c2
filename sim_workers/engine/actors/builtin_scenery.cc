// Columns, lamps, torches, trees, gore, the dead and the barrel that explodes.
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

struct Scenery {
  const char* name;
  int32_t number, spawn_id;
  int radius, height;
  FlagList flags;
  const char* program;
};

/// Somebody's last picture.
struct Dead {
  const char* name;
  int32_t number;
  const char* program;
};

}  // namespace

void add_scenery(ActorCatalog* catalog) {
  const FlagList solid = {kSolid}, hanging = {kSolid, kNoGravity, kSpawnCeiling},
                 loose = {kNoGravity, kSpawnCeiling}, flat = {kNoBlockmap, kMoveWithSector};
  // clang-format off
  const Scenery scenery[] = {
      {"TallGreenColumn", 30, 0, 16, 52, solid, "COL1 A -1"},
      {"ShortGreenColumn", 31, 0, 16, 40, solid, "COL2 A -1"},
      {"TallRedColumn", 32, 0, 16, 52, solid, "COL3 A -1"},
      {"ShortRedColumn", 33, 0, 16, 40, solid, "COL4 A -1"},
      {"Candlestick", 34, 0, 20, 14, {}, "CAND A -1*"},
      {"Candelabra", 35, 0, 16, 60, solid, "CBRA A -1*"},
      {"HeartColumn", 36, 0, 16, 40, solid, "COL5 AB 14; again"},
      {"SkullColumn", 37, 0, 16, 40, solid, "COL6 A -1"},
      {"EvilEye", 41, 0, 16, 54, solid, "CEYE ABCB 6*; again"},
      {"FloatingSkull", 42, 0, 16, 26, solid, "FSKU ABC 6*; again"},
      {"TorchTree", 43, 0, 16, 56, solid, "TRE1 A -1"},
      {"BlueTorch", 44, 0, 16, 68, solid, "TBLU ABCD 4*; again"},
      {"GreenTorch", 45, 0, 16, 68, solid, "TGRN ABCD 4*; again"},
      {"RedTorch", 46, 0, 16, 68, solid, "TRED ABCD 4*; again"},
      {"Stalagtite", 47, 0, 16, 40, solid, "SMIT A -1"},
      {"TechPillar", 48, 0, 16, 128, solid, "ELEC A -1"},
      {"BigTree", 54, 0, 32, 108, solid, "TRE2 A -1"},
      {"ShortBlueTorch", 55, 0, 16, 37, solid, "SMBT ABCD 4*; again"},
      {"ShortGreenTorch", 56, 0, 16, 37, solid, "SMGT ABCD 4*; again"},
      {"ShortRedTorch", 57, 0, 16, 37, solid, "SMRT ABCD 4*; again"},
      {"BurningBarrel", 70, 149, 16, 32, solid, "FCAN ABC 4*; again"},
      {"TechLamp", 85, 0, 16, 80, solid, "TLMP ABCD 4*; again"},
      {"TechLamp2", 86, 0, 16, 60, solid, "TLP2 ABCD 4*; again"},
      {"Column", 2028, 0, 16, 48, solid, "COLU A -1*"},
      {"Gibs", 24, 146, 20, 16, {}, "POL5 A -1"},
      {"DeadStick", 25, 0, 16, 64, solid, "POL1 A -1"},
      {"LiveStick", 26, 0, 16, 64, solid, "POL6 A 6; B 8; again"},
      {"HeadOnAStick", 27, 0, 16, 56, solid, "POL4 A -1"},
      {"HeadsOnAStick", 28, 0, 16, 64, solid, "POL2 A -1"},
      {"HeadCandles", 29, 0, 16, 42, solid, "POL3 AB 6*; again"},
      {"BloodyTwitch", 49, 0, 16, 68, hanging, "GOR1 A 10; B 15; C 8; B 6; again"},
      {"Meat2", 50, 0, 16, 84, hanging, "GOR2 A -1"},
      {"Meat3", 51, 0, 16, 84, hanging, "GOR3 A -1"},
      {"Meat4", 52, 0, 16, 68, hanging, "GOR4 A -1"},
      {"Meat5", 53, 0, 16, 52, hanging, "GOR5 A -1"},
      {"NonsolidMeat2", 59, 0, 20, 84, loose, "GOR2 A -1"},
      {"NonsolidMeat4", 60, 0, 20, 68, loose, "GOR4 A -1"},
      {"NonsolidMeat3", 61, 0, 20, 84, loose, "GOR3 A -1"},
      {"NonsolidMeat5", 62, 0, 20, 52, loose, "GOR5 A -1"},
      {"NonsolidTwitch", 63, 0, 20, 68, loose, "GOR1 A 10; B 15; C 8; B 6; again"},
      {"HangNoGuts", 73, 0, 16, 88, hanging, "HDB1 A -1"},
      {"HangBNoBrain", 74, 0, 16, 88, hanging, "HDB2 A -1"},
      {"HangTLookingDown", 75, 0, 16, 64, hanging, "HDB3 A -1"},
      {"HangTSkull", 76, 0, 16, 64, hanging, "HDB4 A -1"},
      {"HangTLookingUp", 77, 0, 16, 64, hanging, "HDB5 A -1"},
      {"HangTNoBrain", 78, 0, 16, 64, hanging, "HDB6 A -1"},
      {"ColonGibs", 79, 147, 20, 4, flat, "POB1 A -1"},
      {"SmallBloodPool", 80, 148, 20, 1, flat, "POB2 A -1"},
      {"BrainStem", 81, 150, 20, 4, flat, "BRS1 A -1"},
  };
  // clang-format on
  for (const Scenery& row : scenery) {
    ActorType type = start_type(*catalog, "Actor", row.name, row.number, row.spawn_id);
    type.radius = to_fixed(row.radius), type.height = to_fixed(row.height);
    set_flags(&type, row.flags);
    add_type(catalog, std::move(type), std::string("Spawn: ") + row.program);
  }

  // clang-format off
  const Dead dead[] = {
      {"GibbedMarine", 10, "PLAY W -1"},      {"GibbedMarineExtra", 12, "PLAY W -1"},
      {"DeadMarine", 15, "PLAY N -1"},        {"DeadZombieMan", 18, "POSS L -1"},
      {"DeadShotgunGuy", 19, "SPOS L -1"},    {"DeadDoomImp", 20, "TROO M -1"},
      {"DeadDemon", 21, "SARG N -1"},         {"DeadCacodemon", 22, "HEAD L -1"},
      {"DeadLostSoul", 23, "SKUL K -1"},
  };
  // clang-format on
  for (const Dead& row : dead) {
    ActorType type = start_type(*catalog, "Actor", row.name, row.number);
    add_type(catalog, std::move(type), std::string("Spawn: ") + row.program);
  }

  ActorType barrel = start_type(*catalog, "Actor", "ExplosiveBarrel", 2035, 125);
  barrel.health = 20, barrel.radius = to_fixed(10), barrel.height = to_fixed(42);
  set_flags(&barrel, {kSolid, kShootable, kNoBlood, kActivateCross, kDontGib, kNoIceDeath, kOldRadiusDamage});
  add_type(catalog, std::move(barrel),
           "Spawn: BAR1 AB 6; again;"
           "Death: BEXP A 5*; B 5* Scream; C 5*; D 5* Explode; E 10*; TNT1 A 1050 BarrelDestroy; A 5 Respawn;"
           "stay");
}

}  // namespace comrad::doom
