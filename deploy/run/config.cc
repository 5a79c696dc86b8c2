// `comrad config`: the settings that `comrad train` would use with the same flags, and the layer that each value came
// from. Nothing is started but `comrad-scenarios describe` and `comrad-policy-worker --describe`, and nothing is written.

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <tuple>
#include <vector>

#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/start_check.h"
#include "deploy/settings/start_notes.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

ordered_json to_json(const MergedSettings& merged, const std::optional<replay::ReplayPlan>& replay) {
  ordered_json settings = ordered_json::object();
  for (const SettingRow& row : setting_rows()) {
    const std::string text = row.text(merged.config), name(row.name);
    settings[name] = {{"value", row.is_text(text) ? ordered_json(text) : ordered_json::parse(text)},
                      {"from", merged.from.at(name)}};
  }
  ordered_json document = {{"settings", settings}};
  if (replay)
    document["replay"] = {{"capacity_bytes", replay->capacity_bytes},
                          {"capacity_decisions", replay->capacity_transitions},
                          {"fitting_decisions", replay->fitting_decisions},
                          {"decisions_before_training", replay->decisions_before_training},
                          {"compress", replay->compress},
                          {"file", replay->file},
                          {"reason", replay->reason}};
  return document;
}

/// A setting's name, value and layer.
using Row = std::tuple<std::string, std::string, std::string>;

void print_rows(const std::vector<Row>& rows) {
  size_t name_width = 0, value_width = 0;
  for (const auto& [name, value, from] : rows) {
    name_width = std::max(name_width, name.size());
    value_width = std::max(value_width, std::min<size_t>(value.size(), 32));
  }
  for (const auto& [name, value, from] : rows)
    std::printf("%-*s  %-*s  %s\n", static_cast<int>(name_width), name.c_str(), static_cast<int>(value_width),
                value.c_str(), from.c_str());
}

void print_tables(const MergedSettings& merged, const std::optional<replay::ReplayPlan>& replay) {
  std::vector<Row> chosen, built_in;
  for (const SettingRow& row : setting_rows()) {
    const std::string text = row.text(merged.config), name(row.name), from = merged.from.at(name);
    (from == "built-in" ? built_in : chosen).emplace_back(name, text.empty() ? "\"\"" : text, from);
  }
  std::printf("%s, %s, preset %s: settings of the layers above the built-in one\n\n",
              merged.config.run.scenario.c_str(), merged.config.run.algo.name().c_str(),
              word_of(merged.config.run.preset));
  print_rows(chosen);
  std::printf("\nAll the others\n\n");
  print_rows(built_in);
  if (replay) std::printf("\nOn this machine now: %s\n", replay->words().c_str());
}

}  // namespace

int config_command(Arguments arguments) {
  bool json = false;
  CommandLine line("config --scenario NAME --algo NAME [--preset paper|small|gpu] [--json] [settings]",
                   "Prints the settings that `comrad train` would use with the same flags on this machine, "
                   "and the layer that\n"
                   "each value came from: built-in, algorithm, preset, scenario (its rows of the preset), "
                   "file, command line, or\n"
                   "automatic where it was worked out or rounded from the others and the machine. Starts and "
                   "writes nothing.");
  line.add_switch(
      "json", json,
      "print one JSON object on stdout and nothing else: {\"settings\": {NAME: {\"value\": V, "
      "\"from\": LAYER}}}, and for algorithms that have one the \"replay\" chosen for this machine");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("config", parsed.error());
  if (line.help_requested()) return print_settings_help("config", line);
  const Expected<MergedSettings> merged =
      merge_new({line.config_file(), line.typed()}, describe_scenario, usable_cores());
  if (!merged) return report_error("config", merged.error());
  const RunConfig& config = merged->config;
  const Expected<StartCheck> start = check_start(
      config, merged->scenario.env,
      config.run.train_dir + "/" + (config.run.experiment.empty() ? "<run>" : config.run.experiment));
  if (!start) return report_error("config", start.error());
  print_warnings(merged->scenario);
  for (const std::string& text : flags_without_effect(config, line.typed()))
    std::fprintf(stderr, "comrad config: note: %s\n", text.c_str());
  if (json)
    std::printf("%s\n", to_json(*merged, start->replay).dump().c_str());
  else
    print_tables(*merged, start->replay);
  if (const Status begins = check_learning_begins(config, start->replay); !begins)
    return report_error("config", begins.error());  // the values are shown, for they say why
  return kExitDone;
}

}  // namespace comrad::deploy
