// The recipes: which values an algorithm gets where nobody says otherwise, each with its reason, in one table
// (recipes.cc). Three layers are read from here, between RunConfig's defaults and what the user asks:
//
//   built-in < algorithm < preset (its rows for the algorithm, then --qplex_preset, then the scenario's rows)
//            < TOML file < command line
//
// Stage: before a run; the launcher merges them (deploy/config/merged_settings).
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/config.h"
#include "rollout_buffer/core/expected.h"

namespace comrad {

/// One value of a recipe. Presets, settings and algorithms have their canonical names.
struct RecipeRow {
  std::string_view preset;      ///< "paper", "small"; empty: the algorithm's own, in every preset
  std::string_view algorithms;  ///< those that it holds for, separated by blanks
  std::string_view setting;
  std::string_view value;  ///< as on the command line
  std::string_view reason;

  bool is_for(std::string_view algorithm) const;
};

/// The whole table. algorithm_defaults() reads the rows without a preset.
std::span<const RecipeRow> recipe_rows();

/// What --preset and --algo may be called, in the order of messages.
const std::vector<std::string>& preset_names();
const std::vector<std::string>& algorithm_names();

/// The one spelling of an algorithm that travels through the system: lower case, and the names that Sample
/// Factory and the reference use ("APPO", "DQN", "QPLEX") replaced by ours. Unknown names stay, in lower case.
std::string canonical_algorithm(std::string_view algorithm);

/// A preset's rows for one algorithm, a layer above algorithm_defaults(). Origin "preset <name>".
/// Errors: kBadInput for an unknown preset, naming the known ones.
Expected<SettingsLayer> preset_settings(const std::string& preset, const std::string& algorithm);

/// What a scenario says about one preset and algorithm: of its keys "<preset>.<algorithm>.<setting>" those
/// that fit, without the first two parts. The upper part of the preset's layer.
SettingsLayer scenario_settings(const SettingsLayer& training, const std::string& preset,
                                const std::string& algorithm);

}  // namespace comrad
