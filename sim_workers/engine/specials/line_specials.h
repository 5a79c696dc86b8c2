// Line specials, called from lines, things, scripts and states; doomgen/wad/special_names.h lists them.
// What moves sectors is in movers.h. Stage: tic.
#pragma once

#include <array>
#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// WorldEvents::run_special(), but for the specials that start scripts (acs/script_specials.h). All other code
/// calls the world's events.
int32_t execute_special(World& world, const SpecialCall& call);

/// WorldEvents::activate_line().
bool activate_line(World& world, uint32_t line, Actor& activator, bool back_side, Activation how);

/// One warning per level and number.
void warn_of_special(const World& world, int32_t number, const char* what);

/// Switches that flip back; movers.h calls it each tic.
void tic_switches(World& world);

/// Numbers of kinds of damage, as the arguments of specials and ACS count them; unknown ones are kNormal.
DamageType damage_type_of(int32_t number);

/// Sector specials on reset (lights, damage, scrollers, secrets) and what they do to a player who stands
/// on them.
void start_sector_specials(World& world);
void tic_player_in_sector(World& world, int player);

/// A script's damage replaces the special's.
void clear_special_damage(Sector& sector);

/// Teleports to a destination with this thing id (or in a sector with this tag). True when the body
/// fits there.
bool teleport_to(World& world, Actor& actor, int32_t thing_id, int32_t sector_tag, bool fog,
                 bool keep_orientation);

/// Sectors with a tag, in order; tag 0 is the back sector of the calling line.
template <typename Visit>
void for_each_tagged_sector(const World& world, int32_t tag, Visit visit) {
  for (uint32_t i = 0; i < world.sectors().size(); ++i)
    if (world.sectors()[i].tag == tag) visit(i);
}

}  // namespace comrad::doom
