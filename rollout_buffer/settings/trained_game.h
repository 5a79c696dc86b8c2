// The game that a network was trained for, which is the only one that it can play. Stage: before a run.
#pragma once

#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// The settings in a checkpoint's `config/toml`. Keys that this build does not know are passed over: it may be an older
/// or a newer one's checkpoint. Errors: kBadFormat, and those of set(), naming `label`.
Expected<RunConfig> settings_of_checkpoint(std::string_view text, const std::string& label);

/// Why a network that was trained with the settings `trained` cannot play with the settings `played`, as "scenario is
/// lava_pit there and coop_puzzle here"; empty where it can. It compares the scenario and all settings of the environment
/// that shape tensors (team, heads, measurements); variants and versions of a scenario differ in neither. Both are resolved.
std::string game_difference(RunConfig trained, RunConfig played);

}  // namespace comrad
