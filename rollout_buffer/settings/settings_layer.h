// Settings as text, before anything is known of their types: whoever only hands layers on includes this, and is not compiled
// anew when a setting changes.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace comrad {

/// One layer of settings as `key = value` text pairs, in order; a later layer wins.
struct SettingsLayer {
  std::string origin;  ///< named in messages: "command line", "run.toml", "scenario coop_health_gathering"
  std::vector<std::pair<std::string, std::string>> values;
  /// Of a run's config.toml, where `values` hold what was worked out for that run: what had been asked for ("0", auto).
  std::vector<std::pair<std::string, std::string>> asked_for = {};
};

}  // namespace comrad
