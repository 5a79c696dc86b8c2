// Executes bytecode: one script from where it stopped until it waits, ends or is stopped. Stage: tic.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom::acs {

constexpr std::size_t kStackMax = 4096;             ///< values on the stack of a script
constexpr std::size_t kCallsMax = 512;              ///< functions inside each other
constexpr std::size_t kLocalsMax = 1 << 18;         ///< variables of all of them
constexpr std::size_t kArrayElementsMax = 1 << 16;  ///< of a world or global array
constexpr int32_t kNestingMax = 16;                 ///< scripts that wait for each other's results

/// Runs `thread`. Whatever its code does wrong ends that script with MachineState::last_error, nothing else.
void run_thread(World& world, const Behavior& behavior, Thread& thread);

}  // namespace comrad::doom::acs
