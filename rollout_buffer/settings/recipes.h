// The recipes: which values an algorithm gets by default, each with its reason, in one table
// (recipes.cc). Three layers are read from here, between the built-in defaults and the user's settings:
//
//   built-in < algorithm < preset (its rows for the algorithm, then --qplex_preset) < scenario (its rows for both)
//            < TOML file < command line
//
// Stage: before a run; the launcher merges them (deploy/settings/merged_settings).
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/algorithms.h"
#include "rollout_buffer/settings/settings_layer.h"
#include "rollout_buffer/settings/words.h"

namespace comrad {

/// One value of a recipe. Presets, settings and algorithms have their canonical names.
struct RecipeRow {
  std::string_view preset;      ///< "paper", "small", "gpu"; empty: the algorithm's own, in every preset
  std::string_view algorithms;  ///< separated by blanks: names, or words of algorithm_groups()
  std::string_view setting;
  std::string_view value;  ///< as on the command line
  std::string_view reason;

  bool is_for(const AlgorithmName& algorithm) const;
};

/// The whole table. algorithm_defaults() reads the rows without a preset.
std::span<const RecipeRow> recipe_rows();

/// The defaults of an algorithm (LSTM and 4 epochs for IPPO, ...), the layer below the preset's.
SettingsLayer algorithm_defaults(const AlgorithmName& algorithm);

/// A preset's rows for one algorithm, a layer above algorithm_defaults(); those of `gpu` stand over those of `small`. Origin "preset <name>".
SettingsLayer preset_settings(Preset preset, const AlgorithmName& algorithm);

/// The settings that --qplex_preset stands for, in the preset's layer above its rows for the algorithm and below
/// the scenario's: empty for "comrad", the authors' own for "paper". Source: Wang et al. 2021, arXiv:2008.01062.
SettingsLayer qplex_preset_settings(QplexPreset preset);

/// Words for several algorithms at once, in tables of recipes: all, on_policy, q_learning, mixers.
std::span<const std::string_view> algorithm_groups();

/// A scenario's settings for one preset and algorithm: of its keys "<preset>.<algorithm or group>.<setting>" those
/// that fit, without the first two parts; keys of groups first, then of the row's `recipe_of`, then of the row itself.
/// The upper part of the preset's layer; `gpu` reads the keys of `small`, then its own.
SettingsLayer scenario_settings(const SettingsLayer& training, Preset preset, const AlgorithmName& algorithm);

}  // namespace comrad
