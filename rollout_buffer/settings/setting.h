// One row a setting, and what can be done with all of them alike. The rows are in eleven .def files, one a subject:
//
//   SETTING(type, name, default, limits, "help", .old_names = {"lr"}, .fixed_in_a_run = true)
//
// type is bool, int64_t, double, Schedule, std::string, an enum of words.h or AlgorithmName; limits one of the functions below; what
// follows the help are members of SettingTraits and may be left out. To add a setting, add its row: the member of
// RunConfig, its flag, key of TOML files, help, check and line of `comrad config` come from it.
//
// The help of a number states its unit: agent decisions (one agent's), joint decisions (one of every agent), env frames
// (agent decisions x env_frameskip), optimizer steps, seconds, ... A name that could mean two of them ends in its unit
// (train_for_env_frames, learning_starts_decisions). Stage: before a run.
#pragma once

#include <array>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/applies_when.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// The values that a setting may have. Numbers lie between two bounds, each of which may be left out, or are one value
/// beside them; text passes a test.
struct Limits {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  bool is_low_open = false, is_high_open = false;
  double other = std::numeric_limits<double>::quiet_NaN();  ///< allowed beside the bounds
  std::string_view other_words = "";                        ///< what it stands for
  bool (*text_passes)(std::string_view) = nullptr;
  std::string_view text_words = "";  ///< "it must be ..."

  constexpr Limits or_else(double value, std::string_view words) const {
    Limits wider = *this;
    wider.other = value;
    wider.other_words = words;
    return wider;
  }
  bool holds(double value) const;
  bool holds(std::string_view text) const { return text_passes == nullptr || text_passes(text); }
  /// "between 0 and 1, or -1 for the scenario's".
  std::string words() const;
};

namespace limits {

constexpr Limits any() { return {}; }
constexpr Limits between(double low, double high) { return {.low = low, .high = high}; }
constexpr Limits above(double low, double high) { return {.low = low, .high = high, .is_low_open = true}; }
constexpr Limits below(double low, double high) { return {.low = low, .high = high, .is_high_open = true}; }
constexpr Limits at_least(double low) { return {.low = low}; }
constexpr Limits fraction() { return between(0, 1); }
constexpr Limits text(bool (*passes)(std::string_view), std::string_view words) {
  return {.text_passes = passes, .text_words = words};
}
/// Text that is not empty.
constexpr Limits named(std::string_view words) {
  return text([](std::string_view value) { return !value.empty(); }, words);
}

}  // namespace limits

/// What else a row may say.
struct SettingTraits {
  std::array<std::string_view, 2> old_names = {};  ///< accepted as well
  bool fixed_in_a_run = false;                     ///< tensors of a checkpoint or data of a run depend on it
  bool sizes_the_arena = false;                    ///< automatic sizes are made from it
  bool is_automatic_size = false;                  ///< rebuilt when one of those changes
  bool is_a_list = false;                          ///< typed several times, the values are joined by commas
  bool is_of_the_start = false;                    ///< where a run lies and how it was started
  AppliesWhen applies_when = {};                   ///< else that of its .def file
  bool used_by_eval = false;                       ///< has an effect where agents only play
  bool is_changed_first = false;  ///< among the twenty that `comrad help train` shows without --all
};

enum class SettingKind { kBool, kInt, kReal, kSchedule, kText, kWord };

/// A row as the program sees it.
struct SettingRow {
  std::string_view name;
  std::string_view subject;  ///< the .def file
  SettingKind kind;
  Limits limits;
  std::string_view help;
  SettingTraits traits;
  std::vector<std::string> (*words)();                ///< of kWord
  std::string (*text)(const RunConfig&);              ///< as in config.toml, without quotes
  bool (*assign)(RunConfig&, std::string_view text);  ///< false: of the wrong type or no such word
  bool (*holds)(const RunConfig&, const Limits&);     ///< the value is within its limits

  bool has_name(std::string_view key) const;
  /// Whether its value makes a difference among these resolved settings.
  bool applies(const RunConfig& config) const { return traits.applies_when.holds(config); }
  /// Whether TOML and JSON quote this value of its.
  bool is_text(std::string_view value) const;
  /// Whether TOML may have a list of values, which are joined by commas.
  bool may_be_a_list() const { return kind >= SettingKind::kSchedule; }
  /// What the value must be, for messages: "a whole number", "one of gru, lstm".
  std::string must_be() const;
};

/// Every setting, in the order of the files. All say what they count with.
std::span<const SettingRow> setting_rows();
/// The setting of a name or old name, or the one that another system's name (other_names.h) stands for; null where there
/// is none.
const SettingRow* find_setting(std::string_view name);
/// Names and old names of all settings.
std::vector<std::string> setting_names();

/// The value as config.toml has it, without quotes; empty for an unknown name.
std::string setting_text(const RunConfig& config, std::string_view name);
/// A value's text as a line of a TOML file, NAME = VALUE, with its end.
std::string setting_toml(const SettingRow& row, const std::string& text);

/// Parses `text` by the setting's type: whole numbers accept 1e6, booleans true/false/1/0 in any case, words any case.
/// A name of another system (other_names.h) sets what it stands for.
/// Errors: kBadInput for an unknown key (naming the nearest known one, or what to use instead) or a value of the wrong type,
/// naming `origin`.
Status set(RunConfig& config, const std::string& origin, std::string_view key, std::string_view text);

/// Every value is within its row's limits. Errors: kBadInput naming the first that is not, and what it may be.
Status check_limits(const RunConfig& config);

/// The layer widths that `text` lists, separated by commas or blanks ("512,256"); none for "none" or empty
/// text. Errors: kBadInput for more than 8 widths or one outside 1 to 8192.
Expected<std::vector<int64_t>> parse_widths(const std::string& text);

}  // namespace comrad
