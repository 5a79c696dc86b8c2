#include "deploy/settings/layers.h"

#include <algorithm>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/other_names.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {

std::string canonical_setting(const std::string& key) {
  const SettingRow* row = find_setting(key);
  return row == nullptr ? key : std::string(row->name);
}

SettingsLayer only(const SettingsLayer& layer, std::span<const std::string_view> settings) {
  SettingsLayer some{layer.origin, {}};
  for (const auto& value : layer.values)
    if (std::ranges::find(settings, canonical_setting(value.first)) != settings.end())
      some.values.push_back(value);
  return some;
}

Expected<LayeredConfig> merge(const RunConfig& lowest, const std::string& lowest_name,
                              std::span<const NamedLayer> layers) {
  LayeredConfig merged{lowest, {}};
  for (const SettingRow& row : setting_rows()) merged.from[std::string(row.name)] = lowest_name;
  for (const NamedLayer& layer : layers) COMRAD_TRY(merged.put(layer));
  return merged;
}

Status LayeredConfig::put(const NamedLayer& layer) {
  COMRAD_TRY(change(layer.name, [&layer](RunConfig& to) { return apply_layer(to, layer.settings); }));
  for (const auto& [key, text] : layer.settings.values) {
    const OtherName* other = find_other_name(key);
    if (other != nullptr && other->assign != nullptr) {
      for (const std::string_view setting : other->sets)
        if (!setting.empty() && other->applies(config)) from[std::string(setting)] = layer.name;
    } else if (const SettingRow* row = find_setting(key)) {
      from[std::string(row->name)] = layer.name;
    }
  }
  return {};
}

std::vector<std::string> LayeredConfig::texts() const {
  std::vector<std::string> texts;
  for (const SettingRow& row : setting_rows()) texts.push_back(row.text(config));
  return texts;
}

void LayeredConfig::note_changes(const std::vector<std::string>& before, const std::string& name) {
  for (std::size_t i = 0; i < before.size(); ++i)
    if (const SettingRow& row = setting_rows()[i]; row.text(config) != before[i])
      from[std::string(row.name)] = name;
}

}  // namespace comrad::deploy
