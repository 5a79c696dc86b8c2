// The one place where the frame meets the ACS compiler: script.acs, the layout's numbers and the scenario's exports in,
// BEHAVIOR out.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

struct BuiltScript {
  std::string behavior;  ///< empty where this build has no compiler
  std::string source;    ///< of SCRIPTS: the layout's numbers, the exports, then script.acs and more
  std::vector<std::string> warnings;
};

/// Compiles script.acs of the scenario's folder, which sees `layout_text` and a `global int` for each export in front of it
/// (messages keep the file's own lines, and those of scenario.toml for an export), and `more` files of the folder behind
/// it. It may include other files of its folder. Errors: kBadFormat with file, line and column; kSystem.
Expected<BuiltScript> build_script(const ScenarioSpec& spec, const std::string& layout_text,
                                   const std::vector<std::string>& more = {});

}  // namespace comrad::scenarios
