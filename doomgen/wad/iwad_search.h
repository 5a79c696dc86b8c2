// Where the game's own WAD (Freedoom's) lies on this machine.
#pragma once

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::wad {

/// `path` where it is not empty, else $COMRAD_IWAD, else the places where Debian and others keep it.
/// Errors: kNotFound naming the places that were looked at.
Expected<std::string> find_iwad(const std::string& path = {});

}  // namespace comrad::wad
