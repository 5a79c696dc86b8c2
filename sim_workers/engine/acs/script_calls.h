// The functions that scripts call through CallFunc; names and numbers are in doomgen/acs/pcodes.h. Stage:
// tic.
#pragma once

#include <cstdint>
#include <span>

#include "sim_workers/engine/acs/caller.h"

namespace comrad::doom::acs {

struct CallResult {
  int32_t value = 0;
  const char* error = nullptr;  ///< stops the script
};

/// Calls function `number`; missing arguments are 0. An unsupported one is one warning and answers 0.
CallResult call_function(const Caller& caller, int32_t number, std::span<const int32_t> args);

uint32_t integer_root(uint64_t value);  ///< floor of the square root

}  // namespace comrad::doom::acs
