#include "rollout_buffer/settings/settings_layer.h"

#include <algorithm>

namespace comrad {

SettingValues with_settings(SettingValues values, const SettingValues& over) {
  for (const auto& [setting, value] : over) {
    const auto found = std::ranges::find(values, setting, &SettingValues::value_type::first);
    if (found == values.end())
      values.emplace_back(setting, value);
    else
      found->second = value;
  }
  return values;
}

}  // namespace comrad
