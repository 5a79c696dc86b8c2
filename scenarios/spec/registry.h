// All layout recipes at a glance: which function draws the map of which scenario. A new scenario adds one
// line to the table in registry.cc.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/layout_info.h"

namespace comrad::scenarios {

/// What map is wanted.
struct LayoutRequest {
  uint64_t seed = 42;
  int num_agents = 0;  ///< agents that must find a start; 0: as many as the recipe prepares
  /// `--set key=value`, over the recipe's defaults.
  std::vector<std::pair<std::string, std::string>> parameters = {};
};

/// A finished layout.
struct GeneratedLayout {
  std::string wad;            ///< bytes of the file
  uint64_t content_hash = 0;  ///< FNV-1a 64 of them
  LayoutInfo info;
};

/// One parameter of a recipe; all are whole numbers (densities in thousandths).
struct LayoutParameter {
  const char* name;
  int64_t default_value, low, high;
  const char* help;
};

/// Names of the scenarios whose maps this build can draw.
std::vector<std::string> layout_recipes();

/// The parameters of a recipe. Errors: kNotFound naming the known recipes.
Expected<std::vector<LayoutParameter>> layout_parameters(const std::string& scenario);

/// Draws the map of a scenario: a pure function of its arguments, the same bytes on every machine.
/// Errors: kNotFound for an unknown scenario, kBadInput for a parameter that is unknown or out of range, or
/// when none of 20 attempts passes the checks.
Expected<GeneratedLayout> generate_layout(const std::string& scenario, const LayoutRequest& request);

}  // namespace comrad::scenarios
