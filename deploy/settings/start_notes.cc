#include "deploy/settings/start_notes.h"

#include <algorithm>

#include "deploy/settings/game_files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/other_names.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

/// A value in a sentence.
std::string shown(const std::string& text) { return text.empty() ? "empty" : text; }

}  // namespace

std::vector<std::string> flags_without_effect(const RunConfig& config, const SettingsLayer& typed) {
  RunConfig judged = config;
  if (is_generated_layout(judged)) judged.environment.wad.clear();  // not set by the user
  std::vector<std::string> lines;
  const auto judge = [&](std::string_view name, const std::string& text, const AppliesWhen& applies_when) {
    if (applies_when.holds != nullptr && !applies_when.holds(judged))
      lines.push_back("--" + std::string(name) + " " + text + " does nothing in this run (algo " +
                      config.run.algo.name() + "): it applies with " + std::string(applies_when.words));
  };
  for (const auto& [name, text] : typed.values)
    if (const OtherName* other = find_other_name(name); other != nullptr && other->applies_when.holds)
      judge(name, text, other->applies_when);
    else if (const SettingRow* row = find_setting(name))
      judge(row->name, text, row->traits.applies_when);
  return lines;
}

std::vector<std::string> flags_unused_by_eval(const SettingsLayer& typed) {
  std::vector<std::string> lines;
  for (const auto& [name, text] : typed.values)
    if (const SettingRow* row = find_setting(name); row != nullptr && !row->traits.used_by_eval)
      lines.push_back("--" + std::string(row->name) + " " + text + " does nothing in an evaluation");
  return lines;
}

std::string changes_text(const RunConfig& before, const RunConfig& now) {
  std::vector<std::string> changes;
  for (const SettingRow& row : setting_rows()) {
    const std::string was = row.text(before), is = row.text(now);
    const bool is_own_map =
        row.name == "wad" && (was.empty() || is_generated_layout(before)) && is_generated_layout(now);
    if (was == is || row.traits.is_of_the_start || is_own_map) continue;
    changes.push_back(std::string(row.name) + " " + shown(was) + " -> " + shown(is));
  }
  return changes.empty() ? "" : "changed since the last start: " + joined(changes);
}

std::string left_out_text(const SettingsLayer& file) {
  if (file.explicit_values.empty()) {
    // A file that people write names few settings; a run's has them all.
    if (file.values.size() * 2 < setting_rows().size()) return "";
    return file.origin +
           " has no table [explicit] (an older version wrote it): all its settings apply, also those that "
           "were "
           "worked out for that run; remove the settings that this run is to work out itself";
  }
  std::vector<std::string> names;
  for (const auto& [name, text] : file.explicit_values) names.push_back(name);
  return file.origin +
         " is a run's file: its settings apply, and settings worked out for that run are worked out again (" +
         joined(names) + ")";
}

}  // namespace comrad::deploy
