// Calls upwards: what play and specials ask of the systems above them, which they do not know. tic/ answers.
// Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "doomgen/wad/special_names.h"
#include "sim_workers/engine/world/actor.h"

namespace comrad::doom {

using wad::Special;
class World;

/// A line special by its number (doomgen/wad/special_names.h), called from a line, a thing, a script or a state.
struct SpecialCall {
  int32_t number = 0;
  std::array<int32_t, 5> args{};
  Actor* activator = nullptr;  ///< null: the world
  int32_t line = -1;           ///< linedef that called, or -1
  bool back_side = false;
};

/// How a line was touched. Who touches it counts as much: any way of crossing (or using) by a player is a
/// player's, by a missile a missile's, by anybody else a monster's. A line that is activated by whatever
/// crosses needs no separate call.
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

/// One for all worlds: it holds nothing.
class WorldEvents {
 public:
  virtual ~WorldEvents() = default;

  /// Does a special. False (0) where nothing happened; scripts get the number. An unknown special is one
  /// warning per world's level.
  virtual int32_t run_special(World& world, const SpecialCall& call) const = 0;
  /// A line is touched: checks whether this activates it, runs its special, flips switches,
  /// forgets what works once. True when the special did something.
  virtual bool activate_line(World& world, uint32_t line, Actor& activator, bool back_side,
                             Activation how) const = 0;
  /// ACS_NamedExecuteAlways.
  virtual void start_named_script(World& world, std::string_view name, uint32_t activator_id,
                                  const std::array<int32_t, 4>& args) const = 0;
  /// The number of a script with a name, for arguments; one that no script has where there is none.
  virtual int32_t script_number(const World& world, std::string_view name) const = 0;
  virtual void player_died(World& world, int player, uint32_t body_id) const = 0;
  virtual void player_respawned(World& world, int player, uint32_t body_id) const = 0;
};

}  // namespace comrad::doom
