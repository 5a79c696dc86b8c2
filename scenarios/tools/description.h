// What `comrad scenarios describe` states of a scenario: one JSON object for programs (the launcher reads a part of it), or the
// same as text.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::scenarios {

/// Everything about one scenario: shapes, limits, score, heads, masks, rewards, measurements, exported variables, layout
/// parameters and training settings. `num_agents` 0: the scenario's default; `heads` as change_heads() reads them.
/// Errors: as load_scenario() and change_heads(); kBadInput for a team size that the scenario does not support.
Expected<nlohmann::ordered_json> describe(const std::string& name, int num_agents,
                                          const std::string& heads = {});

/// The same for people.
std::string description_text(const nlohmann::ordered_json& description);

}  // namespace comrad::scenarios
