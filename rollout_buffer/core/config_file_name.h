// How a ViZDoom configuration is told from a scenario's name or folder, by the launcher and by what it starts alike.
#pragma once

#include <string_view>

#include "rollout_buffer/core/text.h"

namespace comrad {

/// Whether `scenario` ends in .cfg, in whatever case.
constexpr bool names_vizdoom_config(std::string_view scenario) {
  return scenario.size() > 4 && same_ignoring_case(scenario.substr(scenario.size() - 4), ".cfg");
}

}  // namespace comrad
