#include <spdlog/fmt/fmt.h>

#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <set>
#include <span>

#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/core/toml_text.h"
#include "rollout_buffer/settings/algorithms.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/recipes.h"
#include "rollout_buffer/settings/run_config.h"
#include "scenarios/spec/game_names.h"
#include "scenarios/spec/rewards.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"
#include "scenarios/spec/vizdoom_scenario.h"

namespace comrad::scenarios {
namespace {

constexpr std::size_t kMaxFileBytes = 1 << 20;
constexpr int kMostBases = 8;

Expected<ScenarioSpec> load_scenario(const std::string& name, int depth);

/// Where a value stands, for messages.
std::string place(const std::string& path, const toml::source_region& where) {
  return fmt::format("{}:{}:{}", path, where.begin.line, where.begin.column);
}

/// Reads one table key by key. finish() reports, in this order, an unknown key (it may be a misspelt one that
/// is missing), a key that is missing, and the first wrong value.
class TableReader {
 public:
  /// `inherits`: what is missing keeps the value that it has.
  TableReader(std::string path, const toml::table& table, bool inherits = false)
      : path_(std::move(path)), table_(table), inherits_(inherits) {}

  template <typename T>
  void required(const char* key, T& value) {
    if (!read(key, value)) note_missing(key);
  }
  template <typename T>
  void optional(const char* key, T& value) {
    read(key, value);
  }
  /// A key whose value is one of `known`.
  void choice(const char* key, std::string& value, const std::vector<std::string>& known, bool is_required) {
    if (!read(key, value)) {
      if (is_required) note_missing(key);
      return;
    }
    check_word(key, value, known, table_.get(key)->source());
  }
  /// A key whose value is the name of an export (which becomes its USER variable) or one of `known`.
  void variable(const char* key, std::string& value, const std::vector<ScenarioExport>& exports,
                std::vector<std::string> known, bool is_required) {
    for (const ScenarioExport& one : exports) known.push_back(one.name);
    choice(key, value, known, is_required);
    for (const ScenarioExport& one : exports)
      if (value == one.name) value = fmt::format("USER{}", one.user);
  }
  void words(const char* key, std::vector<std::string>& values, const std::vector<std::string>& known) {
    const toml::node* node = find(key);
    if (node == nullptr) return note_missing(key);
    const toml::array* array = node->as_array();
    if (array == nullptr) return fail(node->source(), std::string("'") + key + "' is no list");
    for (const toml::node& element : *array) {
      const auto word = element.value_exact<std::string>();
      if (!word) return fail(element.source(), std::string("'") + key + "' holds something that is no text");
      check_word(key, *word, known, element.source());
      values.push_back(*word);
    }
  }
  const toml::table* table(const char* key) {
    const toml::node* node = find(key);
    if (node == nullptr) return nullptr;
    if (!node->is_table()) fail(node->source(), std::string("'") + key + "' is no table");
    return node->as_table();
  }
  /// The tables of [[key]]; none where the key is missing.
  std::vector<const toml::table*> tables(const char* key) {
    std::vector<const toml::table*> result;
    const toml::node* node = find(key);
    if (node == nullptr) return result;
    const toml::array* array = node->as_array();
    if (array == nullptr) {
      fail(node->source(), std::string("'") + key + "' is no list of tables: write [[" + key + "]]");
      return result;
    }
    for (const toml::node& element : *array) {
      if (!element.is_table())
        fail(element.source(), std::string("'") + key + "' holds something that is no table");
      else
        result.push_back(element.as_table());
    }
    return result;
  }
  void require(bool holds, const char* key, const std::string& must) {
    if (!holds)
      fail(table_.contains(key) ? table_.get(key)->source() : table_.source(),
           std::string("'") + key + "' must be " + must);
  }
  void fail(const toml::source_region& where, const std::string& what) {
    if (status_) status_ = error_at(where, what);
  }
  /// Keys that are read later, so that finish() accepts them.
  void expect(const std::vector<std::string>& keys) { asked_.insert(keys.begin(), keys.end()); }
  /// Whether the table has the key.
  bool has(const char* key) const { return table_.contains(key); }
  Status finish() {
    if (const toml::key* unknown = first_unknown_key()) {
      const std::string name(unknown->str());
      // What is missing is likelier meant than what is there already.
      std::string near = nearest_word(name, missing_);
      const std::vector<std::string> known(asked_.begin(), asked_.end());
      if (near.empty()) near = nearest_word(name, known);
      return error_at(unknown->source(), "unknown key '" + name + "'" +
                                             (near.empty() ? "; known here: " + joined(known)
                                                           : "; did you mean '" + near + "'?"));
    }
    if (!missing_.empty()) return error_at(table_.source(), "'" + missing_[0] + "' is missing");
    return status_;
  }

 private:
  Error error_at(const toml::source_region& where, const std::string& what) const {
    return Error{ErrorCode::kBadFormat, place(path_, where) + ": " + what};
  }
  void note_missing(const char* key) {
    if (!inherits_ && !has(key)) missing_.emplace_back(key);  // else its value is wrong
  }
  /// In the order of the file; null where each was requested.
  const toml::key* first_unknown_key() const {
    const toml::key* first = nullptr;
    for (const auto& [key, value] : table_) {
      if (asked_.contains(std::string(key.str()))) continue;
      if (first == nullptr || key.source().begin < first->source().begin) first = &key;
    }
    return first;
  }
  const toml::node* find(const char* key) {
    asked_.insert(key);
    return table_.get(key);
  }
  bool read(const char* key, std::string& value) { return read_as<std::string>(key, value, "text"); }
  bool read(const char* key, bool& value) { return read_as<bool>(key, value, "true or false"); }
  bool read(const char* key, double& value) {
    const toml::node* node = find(key);
    if (node == nullptr) return false;
    const auto number = node->is_number() ? node->value<double>() : std::nullopt;
    if (!number || !std::isfinite(*number))
      return fail(node->source(), std::string("'") + key + "' must be a number"), false;
    value = *number;
    return true;
  }
  bool read(const char* key, std::optional<double>& value) {
    double number = 0.0;
    if (!read(key, number)) return false;
    value = number;
    return true;
  }
  bool read(const char* key, int& value) {
    int64_t wide = 0;
    if (!read_as<int64_t>(key, wide, "a whole number")) return false;
    if (wide < INT32_MIN || wide > INT32_MAX)
      return fail(table_.get(key)->source(), std::string("'") + key + "' is out of range"), false;
    value = static_cast<int>(wide);
    return true;
  }
  bool read(const char* key, std::vector<int>& values) {
    const toml::node* node = find(key);
    if (node == nullptr) return false;
    const toml::array* array = node->as_array();
    if (array == nullptr)
      return fail(node->source(), std::string("'") + key + "' must be a list of whole numbers"), false;
    values.clear();
    for (const toml::node& element : *array) {
      const auto number = element.value_exact<int64_t>();
      if (!number || *number < INT32_MIN || *number > INT32_MAX)
        return fail(element.source(), std::string("'") + key + "' must be a list of whole numbers"), false;
      values.push_back(static_cast<int>(*number));
    }
    return true;
  }
  template <typename T>
  bool read_as(const char* key, T& value, const char* type_words) {
    const toml::node* node = find(key);
    if (node == nullptr) return false;
    const auto exact = node->value_exact<T>();
    if (!exact) return fail(node->source(), std::string("'") + key + "' must be " + type_words), false;
    value = *exact;
    return true;
  }
  void check_word(const char* key, const std::string& word, const std::vector<std::string>& known,
                  const toml::source_region& where) {
    if (std::find(known.begin(), known.end(), word) != known.end()) return;
    const std::string near = nearest_word(word, known);
    fail(where, std::string("'") + key + "': '" + word + "' is unknown" +
                    (near.empty() ? "; known: " + joined(known) : "; did you mean '" + near + "'?"));
  }

  std::string path_;
  const toml::table& table_;
  const bool inherits_;
  std::set<std::string> asked_;
  std::vector<std::string> missing_;  // required, not there
  Status status_;
};

Status read_heads(const std::string& path, TableReader& root, ScenarioSpec& spec) {
  if (root.has("heads")) spec.heads.clear();
  for (const toml::table* table : root.tables("heads")) {
    TableReader reader(path, *table);
    ActionHead head;
    reader.words("buttons", head.buttons, button_names());
    reader.require(!head.buttons.empty() && head.buttons.size() < 32, "buttons", "a list of 1 to 31 buttons");
    COMRAD_TRY(reader.finish());
    spec.heads.push_back(std::move(head));
  }
  return {};
}

/// The comment behind a value, without its mark; empty where there is none.
std::string comment_behind(std::string_view text, const toml::source_region& value) {
  for (toml::source_index line = 1; line < value.end.line; ++line) text.remove_prefix(text.find('\n') + 1);
  text = text.substr(0, text.find_first_of("\r\n"));
  text.remove_prefix(std::min<std::size_t>(text.size(), value.end.column - 1));
  const std::size_t mark = text.find('#');
  return mark == std::string_view::npos ? "" : std::string(trimmed(text.substr(mark + 1)));
}

std::string comment_behind(std::string_view text, const toml::table& table, std::string_view key) {
  const toml::node* const value = table.get(key);
  return value == nullptr ? "" : comment_behind(text, value->source());
}

/// Names that a script can spell and that are none of the game's variables, which are in capitals.
bool is_export_name(const std::string& name) {
  const auto is_letter = [](char c) { return c >= 'a' && c <= 'z'; };
  return !name.empty() && is_letter(name[0]) && name != "return" && name != "survival_tics" &&
         std::all_of(name.begin(), name.end(),
                     [&](char c) { return is_letter(c) || (c >= '0' && c <= '9') || c == '_'; });
}

/// [exports]: name = number. `text` is the file's, for the comments.
void read_exports(std::string_view text, TableReader& root, ScenarioSpec& spec) {
  const toml::table* exports = root.table("exports");
  if (exports == nullptr) return;
  for (const auto& [key, node] : *exports) {
    const std::string name(key.str());
    const auto number = node.value_exact<int64_t>();
    if (!is_export_name(name))
      return root.fail(key.source(), "[exports]: '" + name +
                                         "' must be small letters, digits and _, a letter first, and neither "
                                         "'return' nor 'survival_tics'");
    if (!number || *number < 1 || *number > kUserVariables)
      return root.fail(
          node.source(),
          fmt::format("[exports]: '{}' must be a whole number in 1..{}: that of the script's global variable",
                      name, kUserVariables));
    spec.exports.push_back({name, static_cast<int>(*number), comment_behind(text, node.source()),
                            static_cast<int>(key.source().begin.line)});
  }
  std::ranges::sort(spec.exports, {}, &ScenarioExport::line);
  for (auto one = spec.exports.begin(); one != spec.exports.end(); ++one)
    if (const auto first = std::ranges::find(spec.exports.begin(), one, one->user, &ScenarioExport::user);
        first != one)
      return root.fail(exports->get(one->name)->source(),
                       fmt::format("[exports]: '{}' is USER{}, as '{}' in line {} is already", one->name,
                                   one->user, first->name, first->line));
}

/// A stride leads from one global of a script to the next agent's, within USER1..USER60 and the exports, where there are.
void read_stride(TableReader& reader, const char* key, const std::string& variable, int& stride,
                 const ScenarioSpec& spec) {
  reader.optional(key, stride);
  if (stride == 0) return;
  const auto known = find_variable(variable);
  const int agents = spec.supported_agents.empty()
                         ? 1
                         : *std::max_element(spec.supported_agents.begin(), spec.supported_agents.end());
  reader.require(known && known->kind == VariableKind::kUser, key, "0 where the variable is no USER global");
  if (!known || known->kind != VariableKind::kUser) return;
  const int last = known->index + stride * (agents - 1);
  reader.require(stride > 0 && stride < kUserVariables && last <= kUserVariables, key,
                 fmt::format("positive, and the last of {} agents must read USER60 at most", agents));
  if (spec.exports.empty() || stride <= 0) return;
  for (int user = known->index; user <= std::min(last, kUserVariables); user += stride)
    reader.require(std::ranges::count(spec.exports, user, &ScenarioExport::user) == 1, key,
                   fmt::format("a way from one export to the next: [exports] has no USER{}", user));
}

Status read_masks(const std::string& path, TableReader& root, ScenarioSpec& spec) {
  if (root.has("masks")) spec.masks.clear();
  for (const toml::table* table : root.tables("masks")) {
    TableReader reader(path, *table);
    MaskTerm term;
    reader.required("agent", term.agent);
    reader.required("head", term.head);
    const bool head_is_there = term.head >= 0 && term.head < static_cast<int>(spec.heads.size());
    reader.require(head_is_there, "head", "the number of one of the [[heads]], from 0");
    reader.require(term.agent >= 0 && term.agent < kMaxAgents, "agent",
                   fmt::format("in 0..{}", kMaxAgents - 1));
    std::vector<std::string> known{"none"};
    if (head_is_there)
      known.insert(known.end(), spec.heads[term.head].buttons.begin(), spec.heads[term.head].buttons.end());
    reader.words("allowed", term.allowed, known);
    reader.require(!term.allowed.empty(), "allowed", "a list with at least one choice (\"none\" is one)");
    COMRAD_TRY(reader.finish());
    spec.masks.push_back(std::move(term));
  }
  return {};
}

Status read_measurements(const std::string& path, TableReader& root, ScenarioSpec& spec) {
  if (root.has("measurements")) spec.measurements.clear();
  for (const toml::table* table : root.tables("measurements")) {
    TableReader reader(path, *table);
    MeasurementTerm term;
    reader.variable("variable", term.variable, spec.exports, term_variable_names(), true);
    read_stride(reader, "agent_stride", term.variable, term.agent_stride, spec);
    reader.optional("low", term.low);
    reader.optional("high", term.high);
    reader.require(!term.low || !term.high || *term.low <= *term.high, "low", "at most 'high'");
    reader.optional("scale", term.scale);
    reader.optional("offset", term.offset);
    reader.optional("clip", term.clip);
    reader.require(term.clip >= 0.0, "clip", "zero or positive");
    COMRAD_TRY(reader.finish());
    spec.measurements.push_back(std::move(term));
  }
  return {};
}

/// A term that has the name of one of the base's changes that one; others are added.
Status read_rewards(const std::string& path, std::string_view text, TableReader& root, ScenarioSpec& spec) {
  const std::size_t inherited_count = spec.rewards.size();
  for (const toml::table* table : root.tables("rewards")) {
    const std::span base_terms = std::span(spec.rewards).first(inherited_count);
    const auto inherited =
        std::ranges::find(base_terms, (*table)["name"].value_or<std::string>(""), &RewardTerm::name);
    const bool changes_one = inherited != base_terms.end();
    TableReader reader(path, *table, changes_one);
    RewardTerm term = changes_one ? *inherited : RewardTerm{};
    reader.required("name", term.name);
    if (std::string meaning = comment_behind(text, *table, "name"); !meaning.empty())
      term.meaning = std::move(meaning);
    reader.variable("variable", term.variable, spec.exports, term_variable_names(), true);
    read_stride(reader, "agent_stride", term.variable, term.agent_stride, spec);
    reader.variable("when", term.when, spec.exports, term_variable_names(), false);
    reader.variable("unless", term.unless, spec.exports, term_variable_names(), false);
    reader.choice("kind", term.kind, reward_kinds(), true);
    double weight = term.weight.last();
    reader.required("weight", weight);
    term.weight = weight;
    reader.choice("scope", term.scope, reward_scopes(), false);
    reader.optional("cap", term.cap);
    reader.optional("per_agent", term.per_agent);
    reader.require(term.cap >= 0.0, "cap", "zero or positive");
    COMRAD_TRY(reader.finish());
    if (changes_one)
      *inherited = std::move(term);
    else
      spec.rewards.push_back(std::move(term));
  }
  return {};
}

Status read_render(const std::string& path, TableReader& root, ScenarioSpec& spec) {
  const toml::table* table = root.table("render");
  if (table == nullptr) return {};
  TableReader reader(path, *table);
  reader.optional("hud", spec.hud);
  reader.optional("crosshair", spec.crosshair);
  reader.optional("screen_flashes", spec.screen_flashes);
  reader.optional("weapon", spec.weapon);
  return reader.finish();
}

/// One table [training.<preset>.<algorithm or group>]: the keys of its settings get "<preset>.<algorithm>." in front. Each is tried
/// on a RunConfig, so that a wrong one is found here. False after root.fail().
bool read_recipe(TableReader& root, const std::string& preset, const std::string& algorithm,
                 const toml::table& table, SettingsLayer& training) {
  constexpr std::array kChooseARecipe = {"scenario", "env", "algo", "mixer", "preset", "qplex_preset"};
  RunConfig scratch;
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    if (std::count(kChooseARecipe.begin(), kChooseARecipe.end(), name) > 0) {
      root.fail(key.source(), "'" + name + "' chooses the recipe and cannot be part of one; remove it");
      return false;
    }
    const SettingsLayer one{training.origin, {{name, toml_scalar_text(node).value_or("")}}};
    if (const Status applied = apply_layer(scratch, one); !applied) {
      root.fail(key.source(), applied.error().message);
      return false;
    }
    training.values.emplace_back(preset + "." + algorithm + "." + name, one.values[0].second);
  }
  return true;
}

/// The scenario's rows of the recipes: tables [training.<preset>.<algorithm>], or a group of algorithms (recipes.h), and nothing else.
void read_training(TableReader& root, ScenarioSpec& spec) {
  spec.training.origin = "scenario " + spec.name;
  const toml::table* training = root.table("training");
  if (training == nullptr) return;
  const auto refuse = [&](const toml::key& key, const std::string& what) {
    root.fail(key.source(), what +
                                "; a scenario sets values for one preset and an algorithm or several (all, "
                                "on_policy, q_learning, mixers), in a table such as [training.small.ippo]");
  };
  for (const auto& [preset_key, preset_node] : *training) {
    const std::string preset(preset_key.str());
    if (std::ranges::find(Words<Preset>::words, std::string_view(preset)) == Words<Preset>::words.end())
      return refuse(preset_key, unknown_word("preset", preset,
                                             {Words<Preset>::words.begin(), Words<Preset>::words.end()}));
    const toml::table* of_preset = preset_node.as_table();
    if (of_preset == nullptr) return refuse(preset_key, "'training." + preset + "' is no table");
    for (const auto& [algorithm_key, algorithm_node] : *of_preset) {
      std::string name(algorithm_key.str());
      if (std::ranges::find(algorithm_groups(), name) == algorithm_groups().end()) {
        const Expected<const AlgorithmRow*> known = algorithm_named(name);
        if (!known) return refuse(algorithm_key, known.error().message);
        name = (*known)->name;
      }
      const toml::table* of_algorithm = algorithm_node.as_table();
      if (of_algorithm == nullptr)
        return refuse(algorithm_key, "'training." + preset + "." + name + "' is no table");
      if (!read_recipe(root, preset, name, *of_algorithm, spec.training)) return;
    }
  }
}

/// A table of whole numbers in 32 bits. A key that the base has takes its place.
void read_numbers(const std::string& path, TableReader& root, const char* key,
                  std::vector<NamedNumber>& numbers) {
  const toml::table* table = root.table(key);
  if (table == nullptr) return;
  for (const auto& [entry, node] : *table) {
    const std::string name(entry.str());
    const auto value = node.value_exact<int64_t>();
    if (!value || *value < INT32_MIN || *value > INT32_MAX)
      return root.fail(node.source(), "[" + std::string(key) + "]: '" + name + "' must be a whole number");
    std::erase_if(numbers, [&](const NamedNumber& one) { return one.name == name; });
    numbers.push_back({name, *value, place(path, entry.source())});
  }
}

/// [globals]: exports, or USER variables, that the script finds set.
Status check_globals(const ScenarioSpec& spec) {
  for (const NamedNumber& one : spec.globals)
    if (!spec.global_number(one.name)) {
      std::vector<std::string> names{fmt::format("USER1 to USER{}", kUserVariables)};
      for (const ScenarioExport& exported : spec.exports) names.push_back(exported.name);
      return Error{ErrorCode::kBadFormat,
                   one.where + ": [globals]: " + unknown_word("global variable", one.name, names)};
    }
  return {};
}

std::string usual_unit(const ScenarioSpec& spec) {
  if (spec.score == "survival_tics") return "tics";
  if (spec.score == "return") return "reward";
  return spec.score_divisor.empty() ? "count" : "share";
}

Status check_spec(TableReader& root, const std::string& name, const ScenarioSpec& spec) {
  const bool score_is_a_variable = find_variable(spec.score).has_value();
  root.require(spec.name == name, "name", "the name of the folder, '" + name + "'");
  for (const MaskTerm& mask : spec.masks) {
    const auto head = static_cast<std::size_t>(mask.head);
    root.require(head < spec.heads.size() &&
                     std::ranges::all_of(mask.allowed,
                                         [&](const std::string& one) {
                                           return one == "none" ||
                                                  std::ranges::count(spec.heads[head].buttons, one) == 1;
                                         }),
                 "heads", "such that the base's [[masks]] hold for them, or [[masks]] must be written anew");
  }
  root.require(
      spec.score != "return" || !spec.maps_say_ceiling || spec.maps_of == spec.name || !root.has("rewards"),
      "rewards",
      "given with a 'ceiling' (0: not known): the score is the return, and the base's ceiling "
      "does not hold for other rewards");
  root.require(!spec.heads.empty() && spec.heads.size() <= kMaxHeads, "heads",
               fmt::format("1 to {} tables [[heads]]", kMaxHeads));
  root.require(spec.version >= 1 && spec.version <= 1000, "version", "in 1..1000");
  root.require(spec.decision_limit > 0 && spec.decision_limit <= 1'000'000, "decision_limit",
               "in 1..1000000");
  root.require(!spec.supported_agents.empty() &&
                   std::all_of(spec.supported_agents.begin(), spec.supported_agents.end(),
                               [](int n) { return n >= 1 && n <= kMaxAgents; }),
               "supported_agents", fmt::format("a list of numbers in 1..{}", kMaxAgents));
  root.require(
      std::count(spec.supported_agents.begin(), spec.supported_agents.end(), spec.default_agents) == 1,
      "default_agents", "one of supported_agents");
  root.require(spec.shared_reward_alpha >= 0.0 && spec.shared_reward_alpha <= 1.0, "shared_reward_alpha",
               "in 0..1");
  root.require(spec.respawn_delay_tics >= 0 && spec.respawn_delay_tics <= 35 * 600, "respawn_delay_tics",
               "in 0..21000");
  root.require(spec.wad.find('/') == std::string::npos && (spec.wad.empty() || spec.wad[0] != '.'), "wad",
               "the name of a file in the scenario's folder");
  for (const char* key : {"score_scale", "score_divisor", "score_agent_stride"})
    root.require(
        !root.has(key) || score_is_a_variable, key,
        "left out where the score is " + spec.score + ": it belongs to a score that is a game variable");
  return root.finish();
}

/// The base of a scenario that names one: a name, or a path, from the scenario's own folder.
Expected<std::optional<ScenarioSpec>> read_base(const std::string& path, const toml::table& table,
                                                int depth) {
  const toml::node* node = table.get("base");
  if (node == nullptr) return std::optional<ScenarioSpec>();
  const auto refuse = [&](const std::string& what) {
    return Error{ErrorCode::kBadFormat, place(path, node->source()) + ": 'base' " + what};
  };
  if (!node->is_string()) return refuse("must be the name of a scenario, or the path of its folder");
  if (depth >= kMostBases)
    return refuse(fmt::format(
        "leads from scenario to scenario more than {} times; take one out, they may lead in a circle",
        kMostBases));
  std::string base = *node->value<std::string>();
  std::error_code ignored;
  if (base.find('/') != std::string::npos)
    base = (std::filesystem::absolute(path, ignored).parent_path() / base).lexically_normal().string();
  Expected<ScenarioSpec> spec = load_scenario(base, depth + 1);
  if (!spec) return refuse("= \"" + base + "\": " + spec.error().message);
  return std::optional(*std::move(spec));
}

/// `base`: of a variant its scenario; else nothing, and the table may name one.
Expected<ScenarioSpec> read_spec(const std::string& path, const std::string& name, std::string_view text,
                                 const toml::table& table, int depth, std::optional<ScenarioSpec> base) {
  const bool is_variant = base.has_value();
  if (!is_variant) {
    COMRAD_TRY_ASSIGN(base, read_base(path, table, depth));
  }
  ScenarioSpec spec = base.value_or(ScenarioSpec{});
  if (!base) spec.maps_of = name, spec.folder = std::filesystem::path(path).parent_path().string();
  TableReader root(path, table, base.has_value());
  if (is_variant) {
    spec.name = name;
  } else {
    root.expect({"base"});
    root.required("name", spec.name);
  }
  if (base && !is_variant) spec.version = 1;
  root.optional("version", spec.version);
  if (!base) spec.maps_version = spec.version;
  root.required("title", spec.title);
  root.required("summary", spec.summary);
  root.required("difficulty", spec.difficulty);
  root.required("default_agents", spec.default_agents);
  root.required("supported_agents", spec.supported_agents);
  root.required("decision_limit", spec.decision_limit);
  root.optional("respawn", spec.respawn);
  root.optional("respawn_delay_tics", spec.respawn_delay_tics);
  root.optional("wad", spec.wad);
  root.optional("shared_reward_alpha", spec.shared_reward_alpha);
  for (const char* key : {"wad", "exports"})
    root.require(!base || !root.has(key), key,
                 "left out beside 'base': the base's maps are played, with their scripts");
  if (!base) read_exports(text, root, spec);
  std::vector<std::string> scores = variable_names();
  scores.insert(scores.begin(), {"survival_tics", "return"});
  root.variable("score", spec.score, spec.exports, std::move(scores), true);
  if (!base || root.has("score")) spec.score_meaning = comment_behind(text, table, "score");
  root.optional("score_scale", spec.score_scale);
  root.variable("score_divisor", spec.score_divisor, spec.exports, variable_names(), false);
  read_stride(root, "score_agent_stride", spec.score, spec.score_agent_stride, spec);
  if (!base || root.has("score")) spec.score_unit = usual_unit(spec);
  root.choice("score_unit", spec.score_unit, {"tics", "decisions", "kills", "share", "reward", "count"},
              false);
  root.required("ceiling", spec.ceiling);
  if (base && root.has("ceiling")) spec.maps_say_ceiling = false;
  root.expect(
      {"heads", "masks", "measurements", "rewards", "render", "training", "exports", "globals", "layout"});
  COMRAD_TRY(root.finish());  // before the tables, which count on these
  COMRAD_TRY(read_heads(path, root, spec));
  COMRAD_TRY(read_masks(path, root, spec));
  COMRAD_TRY(read_measurements(path, root, spec));
  COMRAD_TRY(read_rewards(path, text, root, spec));
  COMRAD_TRY(read_render(path, root, spec));
  read_numbers(path, root, "globals", spec.globals);
  read_numbers(path, root, "layout", spec.layout);
  read_training(root, spec);
  COMRAD_TRY(check_spec(root, name, spec));
  COMRAD_TRY(check_globals(spec));
  return spec;
}

}  // namespace

EnvShape ScenarioSpec::shape(int num_agents, bool use_measurements) const {
  EnvShape result;
  result.num_agents = num_agents;
  result.measurement_count = use_measurements ? static_cast<int32_t>(measurements.size()) : 0;
  result.head_count = static_cast<int32_t>(heads.size());
  for (std::size_t head = 0; head < heads.size(); ++head)
    result.head_sizes[head] = static_cast<int32_t>(heads[head].buttons.size()) + 1;
  return result;
}

Expected<int> ScenarioSpec::user_number(std::string_view wanted) const {
  std::vector<std::string> known;
  for (const ScenarioExport& one : exports) {
    if (one.name == wanted) return one.user;
    known.push_back(one.name);
  }
  return Error{ErrorCode::kBadFormat,
               folder + "/scenario.toml: " + unknown_word("export", std::string(wanted), known) +
                   "; the scenario's scripted team or map needs it in [exports]"};
}

Expected<int> ScenarioSpec::global_number(const std::string& wanted) const {
  const auto variable = find_variable(wanted);
  return variable && variable->kind == VariableKind::kUser ? Expected<int>(variable->index)
                                                           : user_number(wanted);
}

Expected<std::vector<int>> ScenarioSpec::user_numbers(const std::vector<std::string_view>& wanted) const {
  std::vector<int> numbers;
  for (const std::string_view one : wanted) {
    COMRAD_TRY_ASSIGN(const int number, user_number(one));
    numbers.push_back(number);
  }
  return numbers;
}

namespace {

Expected<ScenarioSpec> load_scenario(const std::string& full_name, int depth) {
  const auto& [scenario, variant] = split_variant(full_name);
  COMRAD_TRY_ASSIGN(const std::string folder, find_scenario_folder(scenario));
  std::string path = folder + "/scenario.toml", name = std::filesystem::path(folder).filename().string();
  std::optional<ScenarioSpec> base;
  if (!variant.empty()) {
    COMRAD_TRY_ASSIGN(path, find_variant_file(folder, variant));
    COMRAD_TRY_ASSIGN(base, load_scenario(scenario, depth));
    name += "@" + variant;
  }
  COMRAD_TRY_ASSIGN(const std::string text, read_scenario_file(path));
  if (text.size() > kMaxFileBytes) return Error{ErrorCode::kBadFormat, path + ": longer than 1 MB"};
  COMRAD_TRY(check_toml_text(text, path));
  try {  // toml++ throws; nothing of it leaves this function
    const toml::table table = toml::parse(text, path);
    return read_spec(path, name, text, table, depth, std::move(base));
  } catch (const toml::parse_error& error) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", path, error.source().begin.line,
                                                    error.source().begin.column, error.description())};
  }
}

}  // namespace

Expected<ScenarioSpec> load_scenario(const std::string& name) {
  return names_vizdoom_config(name) ? load_vizdoom_scenario(name) : load_scenario(name, 0);
}

}  // namespace comrad::scenarios
