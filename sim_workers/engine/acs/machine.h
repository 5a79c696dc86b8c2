// The script machine: runs the bytecode of a Behavior on a World. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom::acs {

constexpr std::size_t kThreadsMax = 1024;  ///< scripts under way in one world; more do not start

struct StartOptions {
  std::array<int32_t, 4> args{};
  uint32_t activator_id = 0;
  int32_t line = -1;
  bool back_side = false;
  bool always = false;     ///< even where it runs already (ACS_ExecuteAlways)
  bool immediate = false;  ///< runs now instead of at the end of the tic, and answers (ACS_ExecuteWithResult)
};

/// Starts a script; a suspended one continues. Returns what it answered where `immediate`, else 1; 0 where
/// there is none, or where it runs already and `always` is not set. What a script starts begins in the
/// next tic; what anything else starts, when the scripts of this tic run.
int32_t start_script(World& world, int32_t number, const StartOptions& options);
int32_t start_script(World& world, std::string_view name, const StartOptions& options);
constexpr int32_t kNoScript = INT32_MIN;  ///< no script has this number
/// The number of a script with a name, in any case; kNoScript where there is none.
int32_t script_number(const World& world, std::string_view name);
/// Both mean the one that runs by itself, not those of ACS_ExecuteAlways.
void suspend_script(World& world, int32_t number);
void terminate_script(World& world, int32_t number);

/// Starts all scripts of a type, with this activator (0: the world), by rising number. `arg`: the player that
/// left, for DISCONNECT.
void start_scripts_of_type(World& world, ScriptType type, uint32_t activator_id, int32_t arg = 0);

/// Initial map variables and arrays, no threads, no messages.
void reset_machine(World& world);

/// One tic of every thread, the one that was started last first, then of the HUD messages.
void tic_machine(World& world);

/// A string by number: the lump's, or a dynamic one. Empty for numbers of none.
std::string_view string_at(const World& world, int32_t index);

}  // namespace comrad::doom::acs
