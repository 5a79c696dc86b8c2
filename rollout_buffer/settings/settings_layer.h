// Settings as text, without their types: code that only passes layers on includes this, and is not compiled
// anew when a setting changes.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace comrad {

/// Settings and their values, each once.
using SettingValues = std::vector<std::pair<std::string, std::string>>;

/// `values` with those of `over` in their place, or behind them.
SettingValues with_settings(SettingValues values, const SettingValues& over);

/// One layer of settings as `key = value` text pairs, in order; a later layer wins.
struct SettingsLayer {
  std::string origin;  ///< named in messages: "command line", "run.toml", "scenario coop_health_gathering"
  SettingValues values;
  /// Of a run's config.toml, where `values` hold what was worked out for that run: the explicit values ("0", auto).
  SettingValues explicit_values = {};
};

}  // namespace comrad
