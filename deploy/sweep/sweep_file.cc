#include "deploy/sweep/sweep_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/core/toml_text.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

constexpr std::size_t kFileBytesMax = 1 << 20;
constexpr std::size_t kNameBytesMax = 100;
constexpr int64_t kSearchRunsMax = 10'000;
constexpr double kFramesMax = 1e15;

/// What the sweep itself gives every run.
constexpr const char* kOwnSettings[] = {"experiment", "train_dir", "restart_behavior"};

/// What makes a search another one, so that scores would not compare.
constexpr const char* kNeverSearched[] = {
    "scenario", "variant", "algo", "preset", "seed", "train_for_env_frames", "train_for_seconds"};

Error refuse(const SweepFile& file, int line, const std::string& message) {
  return {ErrorCode::kBadInput, file.at(line) + message};
}

/// A table of the file whose keys are known words. Each value is taken once; what is left in the end is unknown.
class Keys {
 public:
  Keys(const SweepFile& file, const toml::table& table, std::string label)
      : file_(file), table_(table), label_(std::move(label)) {}

  Status text(const std::string& key, std::string& value) {
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    if (!node->is_string()) return wrong(key, *node, "text");
    value = node->as_string()->get();
    if (value.find_first_of("\n\r") != std::string::npos || value.find('\0') != std::string::npos)
      return wrong(key, *node, "text of one line");
    return {};
  }
  Status whole(const std::string& key, int64_t low, int64_t high, int64_t& value) {
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    if (!node->is_integer() || node->as_integer()->get() < low || node->as_integer()->get() > high)
      return wrong(key, *node, fmt::format("a whole number between {} and {}", low, high));
    value = node->as_integer()->get();
    return {};
  }
  Status positive(const std::string& key, double high, double& value) {
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    const std::optional<double> number = node->value<double>();
    if (!node->is_number() || !number || !(*number > 0) || *number > high)
      return wrong(key, *node, "a number above 0, at most " + real_text(high));
    value = *number;
    return {};
  }
  Status between(const std::string& key, double low, double high, double& value) {
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    const std::optional<double> number = node->value<double>();
    if (!node->is_number() || !(*number >= low) || *number > high)
      return wrong(key, *node, "a number between " + real_text(low) + " and " + real_text(high));
    value = *number;
    return {};
  }
  Status factors(const std::string& key, std::vector<double>& values) {
    constexpr double kFactorMax = 100;
    constexpr std::size_t kFactorsMax = 16;
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    const toml::array* list = node->as_array();
    values.clear();
    for (std::size_t i = 0; list != nullptr && i < list->size() && i <= kFactorsMax; ++i)
      if (const toml::node& one = (*list)[i];
          one.is_number() && *one.value<double>() > 0 && *one.value<double>() <= kFactorMax)
        values.push_back(*one.value<double>());
    if (list == nullptr || values.empty() || values.size() > kFactorsMax || values.size() != list->size())
      return wrong(key, *node, "a list of 1 to 16 factors above 0, at most 100");
    return {};
  }
  /// Any value, which the caller reads; null where it is not there.
  const toml::node* node(const std::string& key) { return take(key); }
  Status truth(const std::string& key, bool& value) {
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    if (!node->is_boolean()) return wrong(key, *node, "true or false");
    value = node->as_boolean()->get();
    return {};
  }
  Status texts(const std::string& key, std::vector<std::string>& values) {
    const toml::node* node = take(key);
    if (node == nullptr) return {};
    const toml::array* list = node->as_array();
    if (list == nullptr) return wrong(key, *node, "a list of texts");
    for (const toml::node& item : *list) {
      if (!item.is_string() || item.as_string()->get().find_first_of("\n\r") != std::string::npos)
        return wrong(key, item, "a list of texts of one line");
      values.push_back(item.as_string()->get());
    }
    return {};
  }
  const toml::table* table(const std::string& key, Status& status) {
    const toml::node* node = take(key);
    if (node != nullptr && !node->is_table()) status = wrong(key, *node, "a table, [" + key + "]");
    return node == nullptr ? nullptr : node->as_table();
  }
  const toml::array* tables(const std::string& key, Status& status) {
    const toml::node* node = take(key);
    if (node == nullptr) return nullptr;
    const toml::array* list = node->as_array();
    const bool is_good = list != nullptr && std::all_of(list->begin(), list->end(),
                                                        [](const toml::node& one) { return one.is_table(); });
    if (!is_good) status = wrong(key, *node, "tables, each below a line [[" + key + "]]");
    return is_good ? list : nullptr;
  }

  /// Errors: the first unknown key.
  Status no_others() const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::ranges::find(known_, name) != known_.end()) continue;
      const std::string hint = did_you_mean(name, known_);
      return refuse(file_, static_cast<int>(key.source().begin.line),
                    "unknown key '" + name + "'" + (label_.empty() ? "" : " in [" + label_ + "]") +
                        (hint.empty() ? " (known: " + joined(known_) + ")" : hint));
    }
    return {};
  }

 private:
  const toml::node* take(const std::string& key) {
    known_.push_back(key);
    return table_.get(key);
  }
  Status wrong(const std::string& key, const toml::node& node, const std::string& must_be) const {
    return refuse(file_, static_cast<int>(node.source().begin.line), key + " must be " + must_be);
  }

  const SweepFile& file_;
  const toml::table& table_;
  std::string label_;
  std::vector<std::string> known_;
};

/// The entries of a table in the order of the file; toml++ sorts them by name.
std::vector<std::pair<const toml::key*, const toml::node*>> in_order(const toml::table& table) {
  std::vector<std::pair<const toml::key*, const toml::node*>> entries;
  for (const auto& [key, node] : table) entries.emplace_back(&key, &node);
  std::ranges::sort(entries, [](const auto& left, const auto& right) {
    const toml::source_position a = left.first->source().begin, b = right.first->source().begin;
    return std::pair(a.line, a.column) < std::pair(b.line, b.column);
  });
  return entries;
}

/// The setting that `key` names. Errors: unknown, or the sweep's own.
Expected<const SettingRow*> setting_of(const SweepFile& file, const toml::key& key) {
  const std::string name(key.str());
  const int line = static_cast<int>(key.source().begin.line);
  const SettingRow* row = find_setting(name);
  if (row == nullptr) {
    const std::string hint = did_you_mean(name, setting_names());
    return refuse(
        file, line,
        "unknown setting '" + name + "'" + (hint.empty() ? "; `comrad train --help` lists them all" : hint));
  }
  if (std::ranges::find(kOwnSettings, row->name) != std::end(kOwnSettings))
    return refuse(file, line, name + " is what the sweep gives each of its runs; leave it out");
  return row;
}

/// The value as config.toml has it. Errors: of the wrong type, no such word, out of range.
Expected<std::string> value_of(const SweepFile& file, const SettingRow& row, const toml::node& node) {
  const int line = static_cast<int>(node.source().begin.line);
  const std::optional<std::string> text = toml_scalar_text(node);
  if (!text) return refuse(file, line, std::string(row.name) + " is neither text, a number, true nor false");
  RunConfig config;
  const std::string origin = fmt::format("{}:{}", file.path, line);
  COMRAD_TRY(set(config, origin, row.name, *text));
  if (!row.holds(config, row.limits))
    return refuse(file, line,
                  std::string(row.name) + " is " + row.text(config) + "; it must be " + row.limits.words());
  return row.text(config);
}

/// `setting = [a, b]`; where `takes_one`, `setting = a` too.
Expected<SweepAxis> axis_of(const SweepFile& file, const toml::key& key, const toml::node& node,
                            bool takes_one) {
  SweepAxis axis;
  COMRAD_TRY_ASSIGN(const SettingRow* row, setting_of(file, key));
  axis.setting = row->name;
  axis.line = static_cast<int>(key.source().begin.line);
  const auto add = [&](const toml::node& one) -> Status {
    COMRAD_TRY_ASSIGN(const std::string value, value_of(file, *row, one));
    if (std::ranges::find(axis.values, value) != axis.values.end())
      return refuse(file, static_cast<int>(one.source().begin.line),
                    axis.setting + " has the value " + value + " twice");
    axis.values.push_back(value);
    axis.lines.push_back(static_cast<int>(one.source().begin.line));
    return {};
  };
  if (const toml::array* list = node.as_array()) {
    for (const toml::node& one : *list) COMRAD_TRY(add(one));
    if (axis.values.empty()) return refuse(file, axis.line, axis.setting + " has no values");
  } else if (takes_one) {
    COMRAD_TRY(add(node));
  } else {
    return refuse(file, axis.line,
                  axis.setting + " must be a list of values here; what all runs share is in [settings]");
  }
  return axis;
}

/// Notes where the file names a setting. Errors: it did before, maybe by another of its names.
Status note_line(SweepFile& file, const std::string& setting, int line) {
  const auto [before, is_new] = file.lines.emplace(setting, line);
  if (!is_new)
    return refuse(file, line, fmt::format("{} is set in line {} already", setting, before->second));
  return {};
}

Status read_axes(SweepFile& file, const toml::table& table) {
  for (const auto& [key, node] : in_order(table)) {
    COMRAD_TRY_ASSIGN(SweepAxis axis, axis_of(file, *key, *node, /*takes_one=*/false));
    COMRAD_TRY(note_line(file, axis.setting, axis.line));
    file.axes.push_back(std::move(axis));
  }
  return {};
}

Status read_settings(SweepFile& file, const toml::table& table) {
  file.settings.origin = file.path;
  for (const auto& [key, node] : in_order(table)) {
    COMRAD_TRY_ASSIGN(const SettingRow* row, setting_of(file, *key));
    COMRAD_TRY(note_line(file, std::string(row->name), static_cast<int>(key->source().begin.line)));
    COMRAD_TRY_ASSIGN(const std::string value, value_of(file, *row, *node));
    file.settings.values.emplace_back(row->name, value);
  }
  return {};
}

/// Some values of an axis. Errors: kBadInput for a value that the axis does not have.
Expected<SweepAxis> condition_of(const SweepFile& file, const SweepAxis& axis, const toml::key& key,
                                 const toml::node& node) {
  COMRAD_TRY_ASSIGN(SweepAxis condition, axis_of(file, key, node, /*takes_one=*/true));
  for (std::size_t i = 0; i < condition.values.size(); ++i)
    if (std::ranges::find(axis.values, condition.values[i]) == axis.values.end())
      return refuse(file, condition.lines[i],
                    condition.setting + " " + condition.values[i] + " is not in [axes]" +
                        did_you_mean(condition.values[i], axis.values));
  return condition;
}

Status read_exclusion(SweepFile& file, const toml::table& table) {
  SweepExclusion exclusion;
  exclusion.line = static_cast<int>(table.source().begin.line);
  for (const auto& [key, node] : in_order(table)) {
    COMRAD_TRY_ASSIGN(const SettingRow* row, setting_of(file, *key));
    const auto axis = std::ranges::find(file.axes, row->name, &SweepAxis::setting);
    if (axis == file.axes.end())
      return refuse(file, static_cast<int>(key->source().begin.line),
                    std::string(row->name) + " is not in [axes], so it excludes nothing");
    COMRAD_TRY_ASSIGN(SweepAxis condition, condition_of(file, *axis, *key, *node));
    exclusion.settings.push_back(std::move(condition));
  }
  if (exclusion.settings.empty())
    return refuse(file, exclusion.line, "this [[exclude]] names no setting, so it would exclude every run");
  file.exclusions.push_back(std::move(exclusion));
  return {};
}

Status read_override(SweepFile& file, const toml::table& table) {
  SweepOverride override;
  override.line = static_cast<int>(table.source().begin.line);
  for (const auto& [key, node] : in_order(table)) {
    COMRAD_TRY_ASSIGN(const SettingRow* row, setting_of(file, *key));
    const auto axis = std::ranges::find(file.axes, row->name, &SweepAxis::setting);
    if (axis != file.axes.end()) {
      COMRAD_TRY_ASSIGN(SweepAxis condition, condition_of(file, *axis, *key, *node));
      override.when.push_back(std::move(condition));
    } else {
      COMRAD_TRY_ASSIGN(const std::string value, value_of(file, *row, *node));
      override.values.emplace_back(row->name, value);
      file.lines.emplace(row->name, static_cast<int>(key->source().begin.line));
    }
  }
  if (override.when.empty() || override.values.empty())
    return refuse(
        file, override.line,
        "this [[override]] needs a setting of [axes] that chooses runs, and a setting that it changes");
  file.overrides.push_back(std::move(override));
  return {};
}

Status read_resources(SweepFile& file, const toml::table& table) {
  Keys keys(file, table, "resources");
  COMRAD_TRY(keys.whole("cores", 1, 4096, file.resources.cores));
  COMRAD_TRY(keys.positive("memory_gb", 1e5, file.resources.memory_gb));
  COMRAD_TRY(keys.whole("gpus", 0, 64, file.resources.gpus));
  return keys.no_others();
}

Status read_results(SweepFile& file, const toml::table& table) {
  Keys keys(file, table, "results");
  COMRAD_TRY(keys.text("folder", file.results.folder));
  COMRAD_TRY(keys.whole("episodes", 2, 100000, file.results.episodes));
  COMRAD_TRY(keys.whole("seed", 0, std::numeric_limits<int64_t>::max(), file.results.seed));
  COMRAD_TRY(keys.truth("greedy", file.results.greedy));
  COMRAD_TRY(keys.no_others());
  if (file.results.folder.empty())
    return refuse(file, static_cast<int>(table.source().begin.line),
                  "[results] names no folder; add a line: folder = \"results\"");
  return {};
}

Status read_slurm(SweepFile& file, const toml::table& table) {
  Keys keys(file, table, "slurm");
  SlurmOptions& slurm = file.slurm;
  COMRAD_TRY(keys.text("partition", slurm.partition));
  COMRAD_TRY(keys.text("account", slurm.account));
  COMRAD_TRY(keys.text("qos", slurm.qos));
  COMRAD_TRY(keys.text("gres", slurm.gres));
  COMRAD_TRY(keys.text("time", slurm.time));
  COMRAD_TRY(keys.whole("signal_before_s", 15, 65535, slurm.signal_before_s));
  COMRAD_TRY(keys.whole("at_once", 0, 100000, slurm.at_once));
  COMRAD_TRY(keys.texts("setup", slurm.setup));
  COMRAD_TRY(keys.texts("options", slurm.options));
  return keys.no_others();
}

/// `setting = {low = 1, high = 9, step = 2, log = true}`.
Status read_range(const SweepFile& file, const SettingRow& row, const toml::table& table,
                  SearchedSetting& searched) {
  const auto refuse_it = [&](const std::string& words) {
    return refuse(file, searched.line, searched.setting + words);
  };
  if (row.kind != SettingKind::kInt && row.kind != SettingKind::kReal && row.kind != SettingKind::kSchedule)
    return refuse_it(" is no number; give it a list of values");
  searched.is_whole = row.kind == SettingKind::kInt;
  Keys keys(file, table, "search.space." + searched.setting);
  const toml::node* ends[] = {keys.node("low"), keys.node("high")};
  COMRAD_TRY(keys.positive("step", kFramesMax, searched.step));
  COMRAD_TRY(keys.truth("log", searched.is_log));
  COMRAD_TRY(keys.no_others());
  for (const toml::node* end : ends) {
    if (end == nullptr || !end->is_number()) return refuse_it(" needs two numbers: {low = ..., high = ...}");
    COMRAD_TRY(value_of(file, row, *end));
    // A value that stands beside the limits (0 for "none") is no end of a range.
    if (const double value = *end->value<double>(); value < row.limits.low || value > row.limits.high)
      return refuse_it(" must lie " + row.limits.words() + ", at both ends of its range");
  }
  searched.low = *ends[0]->value<double>(), searched.high = *ends[1]->value<double>();
  if (!(searched.low < searched.high)) return refuse_it(": low must be below high");
  if (searched.is_log && !(searched.low > 0)) return refuse_it(": with log, low must be above 0");
  if (searched.is_log && searched.step > 0) return refuse_it(" has both log and step; leave one out");
  if (searched.is_whole && searched.step != std::round(searched.step))
    return refuse_it(" is a whole number, and so must its step be");
  const double steps = (searched.high - searched.low) / std::max(searched.step, 1e-300);
  if (searched.step > 0 && std::abs(steps - std::round(steps)) > 1e-6)
    return refuse_it(": high must be low and a whole number of steps");
  return {};
}

Status read_space(SweepFile& file, const toml::table& table) {
  for (const auto& [key, node] : in_order(table)) {
    COMRAD_TRY_ASSIGN(const SettingRow* row, setting_of(file, *key));
    SearchedSetting searched;
    searched.setting = row->name;
    searched.line = static_cast<int>(key->source().begin.line);
    COMRAD_TRY(note_line(file, searched.setting, searched.line));
    const auto refuse_it = [&](const std::string& words) {
      return refuse(file, searched.line, searched.setting + words);
    };
    if (std::ranges::find(kNeverSearched, row->name) != std::end(kNeverSearched))
      return refuse_it(
          " is not searched: scores would not compare; list its values in [axes], or put it in [settings]");
    if (file.search.method == SearchMethod::kPbt &&
        (row->traits.fixed_in_a_run || row->traits.sizes_the_arena))
      return refuse_it(
          " cannot change in a run, and a member of a population changes; search it with random, tpe or "
          "halving");
    if (const toml::table* range = node->as_table()) {
      COMRAD_TRY(read_range(file, *row, *range, searched));
    } else if (node->is_array()) {
      COMRAD_TRY_ASSIGN(SweepAxis axis, axis_of(file, *key, *node, /*takes_one=*/false));
      searched.choices = std::move(axis.values);
      if (searched.choices.size() < 2) return refuse_it(" has one value; put it in [settings]");
    } else {
      return refuse_it(" must be a range, {low = 1e-5, high = 1e-3, log = true}, or a list of values");
    }
    file.search.space.push_back(std::move(searched));
  }
  return {};
}

Status read_search(SweepFile& file, const toml::table& table) {
  SweepSearch& search = file.search;
  search.line = static_cast<int>(table.source().begin.line);
  Keys keys(file, table, "search");
  std::string method;
  COMRAD_TRY(keys.text("method", method));
  const std::optional<SearchMethod> named = search_method(method);
  if (!named) return refuse(file, search.line, unknown_word("method of [search]", method, search_methods()));
  search.method = *named;
  const bool is_pbt = search.method == SearchMethod::kPbt;
  COMRAD_TRY(keys.whole(is_pbt ? "members" : "trials", is_pbt ? 2 : 1, kSearchRunsMax, search.runs));
  COMRAD_TRY(keys.whole("seed", 0, std::numeric_limits<int32_t>::max(), search.seed));
  if (search.method == SearchMethod::kHalving) {
    COMRAD_TRY(keys.positive("first_env_frames", kFramesMax, search.first_env_frames));
    COMRAD_TRY(keys.whole("reduction", 2, 1000, search.reduction));
  }
  if (is_pbt) {
    COMRAD_TRY(keys.positive("every_env_frames", kFramesMax, search.every_env_frames));
    COMRAD_TRY(keys.positive("quantile", 0.5, search.quantile));
    COMRAD_TRY(keys.factors("perturb", search.perturb));
    COMRAD_TRY(keys.between("resample_probability", 0, 1, search.resample_probability));
  }
  Status status;
  const toml::table* space = keys.table("space", status);
  COMRAD_TRY(keys.no_others());
  COMRAD_TRY(status);
  if (search.runs == 0)
    return refuse(file, search.line,
                  std::string("[search] lacks the number of runs; add a line: ") +
                      (is_pbt ? "members = 8" : "trials = 20"));
  if (search.method == SearchMethod::kHalving && search.first_env_frames < 1)
    return refuse(file, search.line,
                  "[search] needs first_env_frames, at least 1: when trials are compared first");
  if (is_pbt && search.every_env_frames < 1)
    return refuse(file, search.line,
                  "[search] needs every_env_frames, at least 1: the length of a generation");
  if (space == nullptr || space->empty())
    return refuse(file, search.line,
                  "nothing to search; add a table [search.space], for example learning_rate = {low = 1e-5, "
                  "high = 1e-3, "
                  "log = true}");
  if (!file.results.folder.empty())
    return refuse(file, search.line,
                  "[results] cannot be had with [search]; evaluate the best run with comrad eval, or put its "
                  "settings into a "
                  "separate sweep");
  return read_space(file, *space);
}

/// The line of a key at the top of the document; 1 where it is not there.
int line_of(const toml::table& document, std::string_view key) {
  const toml::node* node = document.get(key);
  return node == nullptr ? 1 : static_cast<int>(node->source().begin.line);
}

Status check_name(const SweepFile& file, const toml::table& document) {
  if (file.name.empty())
    return refuse(file, line_of(document, "name"), "the sweep has no name; add a line: name = \"my_study\"");
  const bool is_good =
      file.name.size() <= kNameBytesMax && file.name[0] != '.' && std::ranges::all_of(file.name, [](char c) {
        return (lower_case(c) >= 'a' && lower_case(c) <= 'z') || (c >= '0' && c <= '9') || c == '_' ||
               c == '-' || c == '.';
      });
  if (!is_good)
    return refuse(file, line_of(document, "name"),
                  "the name '" + file.name +
                      "' cannot name a folder: up to 100 letters, digits, '_', '-' and '.', not first '.'");
  return {};
}

Status read_document(SweepFile& file, const toml::table& document) {
  Keys keys(file, document, "");
  COMRAD_TRY(keys.text("name", file.name));
  COMRAD_TRY(keys.text("train_dir", file.train_dir));
  COMRAD_TRY(keys.text("report", file.report));
  std::string backend = "local";
  COMRAD_TRY(keys.text("backend", backend));
  Status status;
  const toml::table* axes = keys.table("axes", status);
  const toml::table* settings = keys.table("settings", status);
  const toml::array* exclusions = keys.tables("exclude", status);
  const toml::array* overrides = keys.tables("override", status);
  const toml::table* resources = keys.table("resources", status);
  const toml::table* results = keys.table("results", status);
  const toml::table* search = keys.table("search", status);
  const toml::table* local = keys.table("local", status);
  const toml::table* slurm = keys.table("slurm", status);
  COMRAD_TRY(keys.no_others());
  COMRAD_TRY(status);

  COMRAD_TRY(check_name(file, document));
  if (file.train_dir.empty()) return refuse(file, line_of(document, "train_dir"), "train_dir is empty");
  if (backend != "local" && backend != "slurm")
    return refuse(file, line_of(document, "backend"), unknown_word("backend", backend, {"local", "slurm"}));
  file.backend = backend == "slurm" ? SweepBackend::kSlurm : SweepBackend::kLocal;
  if ((axes == nullptr || axes->empty()) && search == nullptr)
    return refuse(file, line_of(document, "axes"),
                  "nothing to sweep; add a table [axes] with lists, for example seed = [42, 68, 81]");
  if (axes != nullptr) COMRAD_TRY(read_axes(file, *axes));
  if (settings != nullptr) COMRAD_TRY(read_settings(file, *settings));
  if (exclusions != nullptr)
    for (const toml::node& one : *exclusions) COMRAD_TRY(read_exclusion(file, *one.as_table()));
  if (overrides != nullptr)
    for (const toml::node& one : *overrides) COMRAD_TRY(read_override(file, *one.as_table()));
  if (resources != nullptr) COMRAD_TRY(read_resources(file, *resources));
  if (results != nullptr) COMRAD_TRY(read_results(file, *results));
  if (search != nullptr) COMRAD_TRY(read_search(file, *search));
  if (local != nullptr) {
    Keys local_keys(file, *local, "local");
    COMRAD_TRY(local_keys.whole("at_once", 1, 4096, file.local_at_once));
    COMRAD_TRY(local_keys.no_others());
  }
  if (slurm != nullptr) COMRAD_TRY(read_slurm(file, *slurm));
  return {};
}

}  // namespace

Expected<SweepFile> parse_sweep_file(const std::string& text, const std::string& path) {
  SweepFile file;
  file.path = path;
  COMRAD_TRY(check_toml_text(text, path));
  try {
    const toml::table document = toml::parse(text, path);
    COMRAD_TRY(read_document(file, document));
  } catch (const toml::parse_error& failure) {  // a key named twice, too
    return Error{ErrorCode::kBadFormat,
                 file.at(static_cast<int>(failure.source().begin.line)) + std::string(failure.description())};
  }
  return file;
}

Expected<SweepFile> read_sweep_file(const std::string& path) {
  const Expected<std::string> text = read_short_file(path, kFileBytesMax);
  if (!text) return Error{text.error().code, text.error().message + "; give the path of a sweep's TOML file"};
  return parse_sweep_file(*text, path);
}

}  // namespace comrad::deploy
