// What the user should hear of a run's settings before it starts: flags that do nothing, what differs from the last start,
// and what `--config` left out of a run's config.toml. Shown in the terminal and written to the log.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// A line for every typed setting that makes no difference among the resolved settings `config`, saying what it counts
/// with. Values of files are not named: one file may serve several algorithms.
std::vector<std::string> flags_without_effect(const RunConfig& config, const SettingsLayer& typed);

/// The same for an evaluation, which uses few settings.
std::vector<std::string> flags_unused_by_eval(const SettingsLayer& typed);

/// "changed since the last start: gamma 0.995 -> 0.9"; empty where nothing did. The settings of where the run lies, and a map
/// that was generated for it, are left out.
std::string changes_text(const RunConfig& before, const RunConfig& now);

/// What `file`, a run's config.toml, holds that a new run does not take over; empty for other files.
std::string left_out_text(const SettingsLayer& file);

}  // namespace comrad::deploy
