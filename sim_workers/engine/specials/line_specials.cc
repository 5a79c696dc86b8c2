#include "sim_workers/engine/specials/line_specials.h"

#include <algorithm>
#include <iterator>
#include <string>

#include "doomgen/wad/special_names.h"
#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/specials/movers.h"
#include "sim_workers/engine/specials/special_families.h"

namespace comrad::doom {
namespace {

/// Ends the level unless the game's flags forbid it.
bool leave_level(World& world, Actor* activator) {
  if (world.has(wad::GameFlag::kExitAfterMonsters) && world.state().kill_total < world.state().monster_count)
    return false;
  if (world.options().deathmatch && world.has(wad::GameFlag::kNoExit)) {
    if (activator != nullptr) damage_actor(world, *activator, activator, activator, kTelefragDamage);
    return false;
  }
  world.exit_level();
  return true;
}

// ---------------------------------------------------------------- lines and the game

/// Calls visit(line index) for lines with that id; 0 is the calling line.
template <typename Visit>
int32_t for_each_line_with_id(const World& world, const SpecialCall& call, int32_t id, Visit visit) {
  if (id == 0) {
    if (call.line < 0) return 0;
    visit(static_cast<uint32_t>(call.line));
    return 1;
  }
  int32_t count = 0;
  for (uint32_t line = 0; line < world.lines().size(); ++line)
    if (world.lines()[line].id == id) visit(line), ++count;
  return count;
}

/// Line_SetBlocking counts its own bits.
uint32_t blocking_flags(int32_t bits) {
  static constexpr uint32_t kFlags[] = {kLineBlocking,      kLineBlockMonsters,    kLineBlockPlayers,
                                        kLineBlockFloaters, kLineBlockProjectiles, kLineBlockEverything,
                                        kLineRailing,       kLineBlockUse,         kLineBlockSight,
                                        kLineBlockHitscan,  kLineSoundBlock};
  uint32_t flags = 0;
  for (std::size_t bit = 0; bit < std::size(kFlags); ++bit)
    if ((bits >> bit & 1) != 0) flags |= kFlags[bit];
  return flags;
}

void set_texture_offset(World& world, uint32_t line, const SpecialCall& call) {
  constexpr int32_t kNoChange = 32767 << kFracBits;
  constexpr int32_t kAdd = 8;
  const auto& a = call.args;
  const Linedef& linedef = world.level().linedefs[line];
  if (a[3] != 0 && !linedef.back) return;
  const uint32_t side = a[3] != 0 ? *linedef.back : linedef.front;
  const Sidedef& sidedef = world.level().sidedefs[side];
  SideState& state = world.state().sides[side];
  const auto set = [&](int32_t value, int32_t own_offset, Fixed& scroll) {
    if (value == kNoChange) return;
    scroll = clamped_fixed((a[4] & kAdd) != 0 ? int64_t{scroll} + value
                                              : int64_t{value} - int64_t{own_offset} * kFracUnit);
  };
  set(a[1], sidedef.offset_x, state.scroll_x);
  set(a[2], sidedef.offset_y, state.scroll_y);
}

/// Takes the force field off the lines of a tagged sector, or puts it there.
int32_t set_force_field(World& world, int32_t tag, bool on) {
  int32_t any = 0;
  for_each_tagged_sector(world, tag, [&](uint32_t sector) {
    for (const uint32_t line : world.level().sector_linedefs[sector]) {
      const Linedef& linedef = world.level().linedefs[line];
      if (!linedef.back) continue;
      LineState& state = world.state().lines[line];
      any = 1;
      if (on) {
        state.flags |= kLineBlocking | kLineBlockEverything;
        continue;
      }
      state.flags &= ~uint32_t{kLineBlocking | kLineBlockEverything};
      for (const uint32_t side : {linedef.front, *linedef.back}) {
        world.state().sides[side].middle = "-";
        world.state().sides[side].retextured = true;
      }
    }
  });
  return any;
}

std::optional<int32_t> execute_line_special(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  switch (call.number) {
    case Special::kAutosave:
    case Special::kRadius_Quake:  // nothing shakes
    case Special::kSector_ChangeSound:
    case Special::kSetGlobalFogParameter:
      return 1;
    case Special::kForceField:  // the line itself has no
      return 0;
    case Special::kClearForceField:  // tag
      return set_force_field(world, a[0], false);
    case Special::kGlassBreak: {  // the pane goes, actors behind it can be seen
      if (call.line < 0) return 0;
      const Linedef& linedef = world.level().linedefs[static_cast<std::size_t>(call.line)];
      if (!linedef.back) return 0;
      LineState& state = world.state().lines[static_cast<std::size_t>(call.line)];
      state.flags &= ~uint32_t{kLineBlocking | kLineBlockEverything};
      for (const uint32_t side : {linedef.front, *linedef.back}) {
        world.state().sides[side].middle = "-";
        world.state().sides[side].retextured = true;
      }
      return 1;
    }
    case Special::kLine_SetTextureOffset:  // line id, x, y, side, flags
      return for_each_line_with_id(world, call, a[0],
                                   [&](uint32_t line) { set_texture_offset(world, line, call); }) > 0;
    case Special::kLine_SetBlocking:  // line id, set, clear
      for_each_line_with_id(world, call, a[0], [&](uint32_t line) {
        LineState& state = world.state().lines[line];
        state.flags = (state.flags & ~blocking_flags(a[2])) | blocking_flags(a[1]);
      });
      return 1;
    case Special::kTeleport_NewMap:  // map, position, keep facing
    case Special::kTeleport_EndGame:
    case Special::kExit_Normal:  // position
      return leave_level(world, call.activator);
    case Special::kExit_Secret: {
      const bool leaves = leave_level(world, call.activator);
      world.state().exited_secretly = leaves;
      return leaves;
    }
    case Special::kLine_SetIdentification:  // the loader saw to it
      return 0;
    case Special::kUsePuzzleItem:  // no puzzle items in Doom
      return 0;
    case Special::kTranslucentLine:  // line id, amount, additive
      for_each_line_with_id(world, call, a[0], [&](uint32_t line) {
        world.state().lines[line].alpha = static_cast<float>(std::clamp(a[1], 0, 255)) / 255.0f;
      });
      return 1;
    default:
      return std::nullopt;
  }
}

}  // namespace

void warn_of_special(const World& world, int32_t number, const char* what) {
  if (!world.index().warned_specials->first(number)) return;
  const std::string_view name = wad::special_name(number);
  spdlog::warn("{}: special {} {} {}", world.level().name, number, name.empty() ? "(without a name)" : name,
               what);
}

int32_t execute_special(World& world, const SpecialCall& call) {
  if (call.number == 0) return 0;
  SpecialCall checked = call;
  if (checked.line >= static_cast<int64_t>(world.level().linedefs.size())) checked.line = -1;
  if (const auto result = execute_mover_special(world, checked)) return *result;
  for (const auto family :
       {execute_thing_special, execute_teleport_special, execute_sector_special, execute_line_special})
    if (const std::optional<int32_t> result = family(world, checked)) return *result;
  warn_of_special(world, call.number, "is not supported and has no effect");
  return 0;
}

}  // namespace comrad::doom
