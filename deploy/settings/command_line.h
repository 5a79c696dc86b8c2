// The flags of one command: every setting of rollout_buffer/settings under its name and its old names, plus
// what the command adds for itself. Nothing is merged here; what the user typed leaves as one settings layer.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {

/// Which settings a command's help lists. All are accepted.
enum class SettingsListed { kAll, kUsedByEval };

/// How many of the settings `help` lists: the twenty that people change first, or all in groups.
enum class HelpExtent { kFirst, kAll };

/// The values that `help` shows beside the built-in ones.
struct ValuesInForce {
  const RunConfig& config;                         ///< resolved
  const std::map<std::string, std::string>& from;  ///< setting -> layer, as MergedSettings has it
  bool parts_idle = true;  ///< what does nothing with these values stands at the end, by name alone
};

/// Declares flags, parses arguments, prints help. `--name=value` and `--name value` mean the same; a boolean
/// may also stand alone (`--deterministic` is `--deterministic=True`). Of a repeated flag the last one
/// counts, unless it takes a list. Threads: one.  Targets must outlive parse().
class CommandLine {
 public:
  /// `usage` is the line after "usage: comrad ", `about` the paragraph below it.
  CommandLine(std::string usage, std::string about);
  ~CommandLine();
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  /// Every setting of setting_rows(), the names of other_names(), and `--config FILE.toml`.
  void add_settings(SettingsListed listed = SettingsListed::kAll);
  /// A flag of this command alone, without dashes; `value_name` shows in the help.
  void add_option(const std::string& name, std::string& target, const std::string& value_name,
                  const std::string& help);
  /// A number; 1e6 is accepted where the number is whole.
  void add_option(const std::string& name, double& target, const std::string& value_name,
                  const std::string& help);
  /// Words, of a flag that may be typed several times; every value may be several ones separated by commas.
  void add_option(const std::string& name, std::vector<std::string>& target, const std::string& value_name,
                  const std::string& help);
  /// A boolean of this command alone.
  void add_switch(const std::string& name, bool& target, const std::string& help);
  /// A word without dashes; the first one declared is the first one expected. Required unless `target`
  /// is set.
  void add_positional(const std::string& name, std::string& target, const std::string& help);

  /// All words without dashes that no positional takes; may be none.
  void add_words(const std::string& name, std::vector<std::string>& target, const std::string& help);

  /// With `--help` among them the other arguments are read as well, but none is missing.
  /// Errors: kBadInput naming the argument and, for an unknown flag, the nearest known one.
  Status parse(std::span<const std::string> arguments);

  bool help_requested() const { return help_requested_; }
  /// `--all`, which the help of a command with all settings takes.
  HelpExtent help_extent() const { return all_requested_ ? HelpExtent::kAll : HelpExtent::kFirst; }
  /// The settings that were typed, canonical names, in the order of the table; origin "command line".
  const SettingsLayer& typed() const { return typed_; }
  /// Whether the setting or command flag of this canonical name was typed.
  bool was_typed(const std::string& name) const;
  const std::string& config_file() const { return config_file_; }

  /// With `values` the settings show what holds now.
  std::string help(const std::optional<ValuesInForce>& values = std::nullopt,
                   HelpExtent extent = HelpExtent::kAll) const;

 private:
  struct Parser;
  std::unique_ptr<Parser> parser_;
  std::string usage_, about_;
  SettingsLayer typed_{"command line", {}};
  std::string config_file_;
  bool help_requested_ = false, all_requested_ = false;
};

}  // namespace comrad::deploy
