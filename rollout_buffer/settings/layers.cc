#include "rollout_buffer/settings/layers.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/core/toml_text.h"
#include "rollout_buffer/settings/encoder_layers.h"
#include "rollout_buffer/settings/other_names.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {
namespace {

constexpr std::size_t kSettingsBytesMax = 1 << 20;
constexpr const char* kExplicit = "explicit";
constexpr const char* kOldExplicit = "asked_for";  // the table's name in runs of older versions

using Values = std::vector<std::pair<std::string, std::string>>;

/// A value's text; of a list its items with commas between. Nothing for what is neither.
std::optional<std::string> value_text(const toml::node& node) {
  const toml::array* list = node.as_array();
  if (list == nullptr) return toml_scalar_text(node);
  std::vector<std::string> items;
  for (const toml::node& item : *list) {
    std::optional<std::string> text = toml_scalar_text(item);
    if (!text) return std::nullopt;
    items.push_back(*std::move(text));
  }
  return items.empty() ? "none" : joined(items);
}

bool is_subject(std::string_view name) {
  return std::ranges::any_of(setting_rows(), [name](const SettingRow& row) { return row.subject == name; });
}

/// The settings of one table, and of the tables in it that have a subject's name ([network]). Errors: kBadFormat naming the
/// line of a value that is none.
Expected<Values> values_of(const toml::table& table, const std::string& path) {
  Values values;
  for (const auto& [key, node] : table) {
    if (const toml::table* inner = node.as_table(); inner != nullptr && is_subject(key.str())) {
      COMRAD_TRY_ASSIGN(const Values more, values_of(*inner, path));
      values.insert(values.end(), more.begin(), more.end());
      continue;
    }
    const SettingRow* row = find_setting(key.str());
    const bool may_be_a_list = row != nullptr && row->may_be_a_list();
    std::optional<std::string> text = may_be_a_list ? value_text(node) : toml_scalar_text(node);
    if (!text)
      return Error{ErrorCode::kBadFormat,
                   fmt::format("{}:{}:{}: setting '{}' is neither text, a number, true nor false{}", path,
                               node.source().begin.line, node.source().begin.column, key.str(),
                               (may_be_a_list ? ", nor a list of these" : ""))};
    // A run's folder may be moved: what lies in it is named as the file that names it sees it.
    if (row != nullptr && row->name == "encoder" && is_encoder_file(*text))
      text = (std::filesystem::path(path).parent_path() / *text).string();
    values.emplace_back(std::string(key.str()), *std::move(text));
  }
  return values;
}

/// The algorithm that --mixer makes of qmix or qplex; every other keeps its own.
void settle_mixer(RunConfig& config) {
  std::string& mixer = config.mixers.mixer;
  mixer = lower_case(mixer);
  const bool is_chosen = config.run.algo->mixes_q_values() && config.run.algo->mixer != MixerKind::kVdn;
  if (mixer.empty() || !is_chosen) return;
  for (const AlgorithmRow* row : algorithm_rows())
    if (mixer == row->mixer_name) config.run.algo = *row;
}

/// One spelling for an encoder, so that a run's is compared with what is typed.
void settle_encoder(RunConfig& config) { config.network.encoder = canonical_encoder(config.network.encoder); }

/// Keeps "stag_hunt_arena@reference" and the variant alike: what the layer names counts, the variant first.
void settle_variant(const RunConfig& before, bool names_variant, RunConfig& config) {
  constexpr const char* kDefault = "default";
  std::string &scenario = config.run.scenario, &variant = config.run.variant;
  if (names_vizdoom_config(scenario)) return;
  const std::size_t mark = find_variant(scenario);
  const bool says_one = mark != std::string::npos && scenario != before.run.scenario;
  if (says_one && !names_variant) variant = scenario.substr(mark + 1);
  if (variant == kDefault) variant.clear();
  scenario.resize(std::min(mark, scenario.size()));
  if (!variant.empty()) scenario += "@" + variant;
}

/// What a run had whose file is older than these settings.
RunConfig oldest_run() {
  RunConfig config;
  config.environment.scenario_version = 1;
  config.environment.renderer = RendererKind::kOsmesa;
  return config;
}

}  // namespace

Status apply_layer(RunConfig& config, const SettingsLayer& layer) {
  const RunConfig before = config;
  // Names that mean something in some runs only are read when the layer's other values say which run it is.
  const auto put = [&](bool comes_last) -> Status {
    for (const auto& [key, text] : layer.values) {
      const OtherName* other = find_other_name(key);
      if (comes_last == (other != nullptr && other->applies_when.holds != nullptr))
        COMRAD_TRY(set(config, layer.origin, key, text));
    }
    return {};
  };
  COMRAD_TRY(put(false));
  settle_mixer(config);
  COMRAD_TRY(put(true));
  settle_encoder(config);
  settle_variant(
      before, std::ranges::count(layer.values, "variant", [](const auto& value) { return value.first; }) > 0,
      config);
  return {};
}

Expected<SettingsLayer> read_settings_toml(const std::string& path) {
  const Expected<std::string> words = read_short_file(path, kSettingsBytesMax);
  if (!words)
    return Error{words.error().code, words.error().message + "; give the path of a TOML file of settings"};
  SettingsLayer layer{path, {}, {}};
  COMRAD_TRY(check_toml_text(*words, path));
  try {
    toml::table document = toml::parse(*words, path);
    for (const char* name : {kOldExplicit, kExplicit}) {
      const toml::table* explicit_values = document[name].as_table();
      if (explicit_values == nullptr) continue;
      COMRAD_TRY_ASSIGN(layer.explicit_values, values_of(*explicit_values, path));
      document.erase(name);
    }
    COMRAD_TRY_ASSIGN(layer.values, values_of(document, path));
  } catch (const toml::parse_error& failure) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", path, failure.source().begin.line,
                                                    failure.source().begin.column, failure.description())};
  }
  return layer;
}

std::string settings_to_toml(const RunConfig& config, const Values& explicit_values) {
  std::string text;
  std::string_view subject;
  for (const SettingRow& row : setting_rows()) {
    if (row.subject != subject)
      text += (subject.empty() ? "" : "\n") + ("## " + std::string(row.subject)) + "\n\n";
    subject = row.subject;
    const std::string_view others = row.traits.applies_when.words;
    text += "# " + std::string(row.help) + (others.empty() ? "" : "; with " + std::string(others)) + "\n" +
            setting_toml(row, row.text(config));
  }
  if (explicit_values.empty()) return text;
  text +=
      "\n## Explicit values of settings whose value above depends on other settings, the scenario, the "
      "machine "
      "or the\n"
      "## run's name. `--config` with this file uses these, so that a new run resolves its own.\n\n[" +
      std::string(kExplicit) + "]\n";
  for (const auto& [name, value] : explicit_values)
    if (const SettingRow* row = find_setting(name)) text += setting_toml(*row, value);
  return text;
}

std::string changed_settings_to_toml(const RunConfig& config) {
  const RunConfig without_rows = oldest_run();
  std::string rows;
  for (const SettingRow& row : setting_rows()) {
    const bool names_a_run = row.name == "scenario" || row.name == "algo" || row.name == "seed";
    const std::string value = row.text(config);
    if (names_a_run || value != row.text(without_rows)) rows += setting_toml(row, value);
  }
  return rows;
}

Expected<RunConfig> load_run_config(const std::string& path) {
  COMRAD_TRY_ASSIGN(const SettingsLayer layer, read_settings_toml(path));
  RunConfig config = oldest_run();
  COMRAD_TRY(apply_layer(config, layer));
  return config;
}

}  // namespace comrad
