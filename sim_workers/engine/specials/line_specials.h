// Line specials, called from lines, things, scripts and states; doomgen/wad/special_names.h lists them.
// What moves sectors is in movers.h. Stage: tic.
#pragma once

#include <array>
#include <cstdint>

#include "doomgen/wad/special_names.h"
#include "sim_workers/engine/play/world.h"

namespace comrad::doom {

using wad::Special;

struct SpecialCall {
  int32_t number = 0;
  std::array<int32_t, 5> args{};
  Actor* activator = nullptr;  ///< null: the world
  int32_t line = -1;           ///< linedef that called, or -1
  bool back_side = false;
};

/// Does it. False (0) where nothing happened; scripts get the number. An unknown special is one warning per
/// world's level.
int32_t execute_special(World& world, const SpecialCall& call);

/// How a line was touched. Who touches it counts as much: any way of crossing (or using) by a player is a
/// player's, by a missile a missile's, by anybody else a monster's. A line that is activated by whatever
/// crosses needs no call of its own.
enum class Activation : uint8_t {
  kCross,
  kUse,
  kMonsterCross,
  kMonsterUse,
  kImpact,
  kPush,
  kMissileCross,
  kAnyCross,
  kUseBack
};

/// A line is touched: checks how it wants to be activated and by whom, runs its special, flips switches,
/// forgets what works once. True when the special did something.
bool activate_line(World& world, uint32_t line, Actor& activator, bool back_side, Activation how);

/// Switches that flip back; movers.h calls it each tic.
void tic_switches(World& world);

/// Numbers of kinds of damage, as the arguments of specials and ACS count them; unknown ones are kNormal.
DamageType damage_type_of(int32_t number);

/// Sector specials on reset (lights, damage, scrollers, secrets) and what they do to a player who stands on
/// them.
void start_sector_specials(World& world);
void tic_player_in_sector(World& world, int player);

/// Teleports to a destination with this thing id (or in a sector with this tag). True when the body fits
/// there.
bool teleport_to(World& world, Actor& actor, int32_t thing_id, int32_t sector_tag, bool fog,
                 bool keep_orientation);
/// Telefrags what stands there when `telefrag`; the low-level move with fog and eye.
bool teleport_move(World& world, Actor& actor, Fixed x, Fixed y, Fixed z, Angle angle, bool fog,
                   bool keep_velocity, bool telefrag);

/// Sectors with a tag, in order; tag 0 is the back sector of the calling line.
template <typename Visit>
void for_each_tagged_sector(const World& world, int32_t tag, Visit visit) {
  for (uint32_t i = 0; i < world.sectors().size(); ++i)
    if (world.sectors()[i].tag == tag) visit(i);
}

}  // namespace comrad::doom
