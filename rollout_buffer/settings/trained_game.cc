#include "rollout_buffer/settings/trained_game.h"

#include <spdlog/fmt/fmt.h>

#include <toml++/toml.h>

#include <optional>

#include "rollout_buffer/core/toml_text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {

Expected<RunConfig> settings_of_checkpoint(std::string_view text, const std::string& label) {
  COMRAD_TRY(check_toml_text(text, label));
  RunConfig config;
  try {
    for (const auto& [key, node] : toml::parse(text, label)) {
      const std::optional<std::string> value = toml_scalar_text(node);
      if (value && find_setting(key.str()) != nullptr) COMRAD_TRY(set(config, label, key.str(), *value));
    }
  } catch (const toml::parse_error& failure) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", label, failure.source().begin.line,
                                                    failure.source().begin.column, failure.description())};
  }
  return config;
}

std::string game_difference(RunConfig trained, RunConfig played) {
  for (RunConfig* const config : {&trained, &played})
    (void)apply_layer(*config, {"",
                                {{"variant", "default"},
                                 {"scenario_version", "0"}}});  // other rules, the same sights and actions
  for (const SettingRow& row : setting_rows()) {
    const bool shapes_the_game =
        row.name == "scenario" || (row.subject == "environment" && row.traits.fixed_in_a_run);
    if (!shapes_the_game || row.text(trained) == row.text(played)) continue;
    const auto shown = [&row](const RunConfig& config) {
      const std::string text = row.text(config);
      return text.empty() ? std::string("the scenario's own") : text;
    };
    return std::string(row.name) + " is " + shown(trained) + " there and " + shown(played) + " here";
  }
  return "";
}

}  // namespace comrad
