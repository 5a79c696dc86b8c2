// The search of `comrad tune`: axes one after the other, each alternative against the best so far, twice before it wins.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::deploy {

/// Setting, value: what is said on top of what the user said.
using TunedSettings = SettingValues;

/// What is tried in place of what is in force: a setting's other value each, or values that belong together.
using TuneAxis = std::vector<TunedSettings>;

/// One measurement.
struct TuneTry {
  TunedSettings settings;
  double rate = 0;      ///< decisions/s; 0: it failed
  double ratio = 0;     ///< to the best so far, measured just before
  std::string failure;  ///< in words; empty: none
};

struct TuneResult {
  TunedSettings best;
  double ratio = 1;  ///< of the best to what the search began with: the product of the ratios that won
  std::vector<TuneTry> tries;
  bool is_whole = true;  ///< false: time ran out before the last axis
};

/// An alternative wins when it is faster than the best so far by this share, in two measurements each.
constexpr double kLeastGain = 0.03;

/// `measure` gives decisions/s, or why these settings cannot be run; `has_time` is asked before every axis.
/// Errors: those of measure() for the settings that the search begins with.
Expected<TuneResult> tune(const std::vector<TuneAxis>& axes,
                          const std::function<Expected<double>(const TunedSettings&)>& measure,
                          const std::function<bool()>& has_time);

/// The lines of a file for `comrad train --config`.
std::string toml_of(const TunedSettings& settings);

/// What is tried for a run of `config`, resolved, on so many cores: what changes the rate and not what is learned.
std::vector<TuneAxis> tune_axes(const RunConfig& config, int cores);

}  // namespace comrad::deploy
