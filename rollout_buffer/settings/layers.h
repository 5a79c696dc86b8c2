// Layers of settings, and the TOML files that hold them: a later layer wins over an earlier one. Stage: before a run (the
// launcher merges), and the first step of every worker (load_run_config).
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad {

/// Puts a layer on top of `config`, as set() of setting.h does with each of its values; then --mixer chooses among qmix's
/// and qplex's. Errors: those of set().
Status apply_layer(RunConfig& config, const SettingsLayer& layer);

/// Reads a TOML file of settings into a layer. Settings may be in a table of their subject ([network]); a list is its items
/// with commas between; `encoder` names a .pt file relative to the TOML file. Other tables are errors, but for [explicit] of a
/// run's config.toml.
/// Errors: kNotFound, kBadFormat with line and column.
Expected<SettingsLayer> read_settings_toml(const std::string& path);

/// The merged settings as a TOML document that read_settings_toml reads back without loss. `explicit_values` becomes its table of
/// that name.
std::string settings_to_toml(const RunConfig& config,
                             const std::vector<std::pair<std::string, std::string>>& explicit_values = {});

/// The rows alone that differ from what load_run_config() makes of an empty file, and what names a run: its scenario, algorithm
/// and seed. Read back it gives `config` for as long as the built-in settings stay what they are.
std::string changed_settings_to_toml(const RunConfig& config);

/// Reads config.toml of a run, whose values and not those of [explicit] count: every worker's first step. One that names no
/// version of its scenario is older than versions, and played the first.
Expected<RunConfig> load_run_config(const std::string& path);

}  // namespace comrad
