// Builds a WAD's nodes with the external program zdbsp. Only on request: our engine needs none, and with them
// the bytes of a file would depend on what is installed.
#pragma once

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// Runs zdbsp on the bytes of a WAD and returns those of the finished one. Errors: kNotFound where the
/// program is not installed, kBadInput with its last words where it refuses the map, kSystem.
Expected<std::string> build_nodes(const std::string& wad);

}  // namespace comrad::doomgen
