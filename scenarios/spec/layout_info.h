// A generated WAD's description of itself: scenario, seed and parameters, as TOML text in the lump COMRAD.
// Scripts have the numbers compiled in; engines that do not know the lump skip it.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::scenarios {

constexpr const char* kLayoutInfoLump = "COMRAD";

/// A layout's identity: (scenario, parameters, seed), and which attempt passed the checks.
struct LayoutInfo {
  std::string scenario;
  uint64_t seed = 42;
  int version = 1;  ///< of the scenario, ScenarioSpec::version
  int attempt = 0;  ///< the seed that drew the map is seed + 1000 * attempt
  std::map<std::string, int64_t> parameters;
  /// By team size: the best score J that the map allows. Sizes that cannot solve it are not in it; empty:
  /// nothing is known.
  std::map<int, double> ceiling = {};

  /// The parameter, or `otherwise` where the WAD does not give it.
  int64_t parameter(const std::string& name, int64_t otherwise) const {
    const auto found = parameters.find(name);
    return found == parameters.end() ? otherwise : found->second;
  }
};

/// The lump's text.
std::string write_layout_info(const LayoutInfo& info);

/// That the WAD at `path`, whose description is `info`, is a map of `scenario`. Errors: kBadInput with two ways out.
Status check_scenario(const LayoutInfo& info, const std::string& scenario, const std::string& path);

/// Reads the lump's text. Errors: kBadFormat with line and column.
Expected<LayoutInfo> parse_layout_info(std::string_view text);

}  // namespace comrad::scenarios
