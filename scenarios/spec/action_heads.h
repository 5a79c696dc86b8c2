// Heads that a user requests in place of a scenario's, and those that a list of buttons makes. Stage: what an action means.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

/// One head for each way to move, turn, look and choose a weapon, of which one thing at a time can be done, and one for each
/// other button; a delta button becomes a few choices of its head.
std::vector<ActionHead> heads_of_buttons(const std::vector<std::string>& button_names);

/// Gives `spec` the heads that `text` names, as the setting `heads` has them: "MOVE_LEFT,MOVE_RIGHT;ATTACK", choices as
/// parse_press() reads them. An empty text keeps them.
/// Errors: kBadInput for a button that the scenario's own heads do not have, an empty head, a head of more than 31 choices;
/// kUnsupported for more than kMaxHeads heads, and where the scenario has [[masks]], which count its own.
Status change_heads(ScenarioSpec& spec, const std::string& text);

}  // namespace comrad::scenarios
