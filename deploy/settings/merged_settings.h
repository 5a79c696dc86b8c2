// Merges the layers of settings into the one RunConfig that a run directory's config.toml holds:
//
//   built-in < algorithm < preset < scenario < TOML file < command line          a new run
//   config.toml of the run                   < TOML file < command line          resuming or evaluating a run
//
// A preset's layer is its rows for the algorithm, and over them what --qplex_preset stands for; a scenario has rows for preset
// and algorithm.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "deploy/settings/scenario_description.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Describes a scenario; describe_scenario outside of tests.
using Describe = std::function<Expected<ScenarioDescription>(const RunConfig&)>;

struct MergedSettings {
  RunConfig config;              ///< no zero that means "auto" is left
  ScenarioDescription scenario;  ///< for config.environment.num_agents
  /// Setting -> the layer that its value came from: "built-in" (or "run", on top of a run's config.toml), "algorithm",
  /// "preset", "scenario", "file", "command line", the name of a command's `changes`, or "automatic" where the value
  /// was worked out or rounded from others and the host.
  std::map<std::string, std::string> from;
  /// Explicit values ("0", auto) of settings whose value was worked out or rounded, in the order of the settings.
  std::vector<std::pair<std::string, std::string>> explicit_values = {};
};

/// The layers above the scenario's: a TOML file when `config_file` is set, then what was typed.
struct UserSettings {
  std::string config_file;
  SettingsLayer typed{"command line", {}};
};

/// Where a run lies, and what becomes of one that is there.
struct RunPlace {
  std::string train_dir;  ///< absolute
  bool is_default_train_dir = false;
  std::string experiment;  ///< empty: the run names itself
  RestartBehavior restart_behavior = RestartBehavior::kResume;
};

/// What a new run takes from the user's TOML file; empty without one. From a run's config.toml it takes that run's explicit
/// settings, and not its name, its generated map and what was worked out for it. Errors: those of read_settings_toml.
Expected<SettingsLayer> file_layer(const UserSettings& user);

/// The user's settings of the run's place, before it is known whether the run is new; `file` as file_layer() reads it.
/// Errors: those of apply_layer().
Expected<RunPlace> place_of_run(const SettingsLayer& file, const SettingsLayer& typed);

/// A new run's settings. `changes` lie above the preset and below the file, for commands whose own defaults differ
/// (a bench has no end by frames). Errors: kBadInput and kBadFormat of any layer, naming it;
/// those of resolve_settings.
Expected<MergedSettings> merge_new(const UserSettings& user, const Describe& describe, int core_count,
                                   const SettingsLayer& changes = {});

/// The settings of an existing run with the user's settings on top. Settings that shape the network or the data
/// (fixed_in_a_run) cannot change; a different value is an error that names the run's. Of a run's config.toml in
/// `user.config_file` everything that was worked out is left out.
Expected<MergedSettings> merge_onto_run(const RunConfig& run, const UserSettings& user,
                                        const Describe& describe, int core_count);

}  // namespace comrad::deploy
