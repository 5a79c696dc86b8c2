// The launcher's description of a scenario: the output of `comrad-scenarios describe`. The launcher links no
// scenario code; it runs the program beside it, so that a scenario stays one folder.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::deploy {

struct ScenarioDescription {
  std::string name;
  std::string folder;  ///< absolute, of a folder of the present one that was named without a path; else empty
  std::string title;
  int64_t version = 1;
  EnvShape
      env;  ///< for the asked number of agents; with the scenario's global state, which not every run requires
  std::vector<int> supported_agents;
  int64_t decision_limit = 0;  ///< decisions after which an episode is truncated
  double ceiling = 0;          ///< best possible score J
  double shared_reward_alpha = 0;
  std::string score;                 ///< what J is: survival_tics, ...
  std::string score_unit;            ///< tics, decisions, kills, share, reward or count
  std::vector<std::string> rewards;  ///< names of its reward terms
  std::vector<std::string>
      warnings;  ///< of a ViZDoom .cfg: "path:line: " what is not understood or not served
  SettingsLayer
      training;  ///< its rows of the recipes, keys "<preset>.<algorithm>.<setting>"; origin "scenario <name>"
};

/// Reads the JSON of `comrad-scenarios describe`. Errors: kBadFormat naming the key that is missing or wrong.
Expected<ScenarioDescription> parse_description(std::string_view json);

/// Its warnings, on standard error.
void print_warnings(const ScenarioDescription& scenario);

/// Starts `comrad-scenarios describe` for the scenario, team and heads of `config`. `num_agents` 0 requests the scenario's
/// default; without `use_additional_input` the shape has no measurements. Errors: kBadInput for an unknown scenario or team size,
/// naming the known ones; kNotFound without the program.
Expected<ScenarioDescription> describe_scenario(const RunConfig& config);

}  // namespace comrad::deploy
