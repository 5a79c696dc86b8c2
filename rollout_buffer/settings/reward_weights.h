// The setting `reward`: weights of reward terms in place of the scenario's. Stage: before a run.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/schedule.h"

namespace comrad {

/// Of one reward term, in place of the scenario's.
struct RewardWeight {
  std::string name;
  Schedule weight;
};

/// What the setting must be, for messages.
inline constexpr std::string_view kRewardWeightsWords =
    "up to 64 weights as NAME=WEIGHT,NAME=WEIGHT, each a number of at most 1e6 or, over env frames, as "
    "NAME=0@0,3@2e6 (steps) or NAME=0@0..3@2e6 (a line)";

/// The weights that `text` lists as NAME=WEIGHT, separated by commas, in its order; none for empty text. A WEIGHT may be a schedule,
/// whose commas are its own: "hare_kill=0@0,3@2.4e6,own_death=-1".
/// Errors: kBadInput for a name without a weight, one that is no schedule or beyond +-1e6, or more than 64 of them.
Expected<std::vector<RewardWeight>> parse_reward_weights(const std::string& text);
/// Whether one of them is not the same all the time.
bool has_reward_schedule(const std::string& text);

}  // namespace comrad
