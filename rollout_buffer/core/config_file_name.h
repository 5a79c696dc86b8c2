// What a scenario's name implies, to the launcher and to what it starts alike: a ViZDoom configuration, a variant.
#pragma once

#include <cstddef>
#include <string_view>

#include "rollout_buffer/core/text.h"

namespace comrad {

/// Whether `scenario` ends in .cfg, in whatever case.
constexpr bool names_vizdoom_config(std::string_view scenario) {
  return scenario.size() > 4 && same_ignoring_case(scenario.substr(scenario.size() - 4), ".cfg");
}

/// Where "@variant" begins in a scenario's name or the path of its folder; npos where it names none.
constexpr std::size_t find_variant(std::string_view scenario) {
  return scenario.find('@', scenario.find_last_of('/') + 1);  // npos + 1 is 0
}

}  // namespace comrad
