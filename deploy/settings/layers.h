// Layers of settings on top of one another, and the layer that each value came from.
#pragma once

#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::deploy {

/// A layer and what `comrad config` calls it.
struct NamedLayer {
  std::string name;
  SettingsLayer settings;
};

/// Settings that remember which layer each of their values came from.
struct LayeredConfig {
  RunConfig config;
  std::map<std::string, std::string> from;  ///< setting -> layer, of every setting

  /// The settings that `layer` names are its own even where their value stays. Errors: those of apply_layer().
  Status put(const NamedLayer& layer);

  /// What `edit` changes came from the layer `name`. Errors: those of `edit`.
  template <typename Edit>
  Status change(const std::string& name, Edit&& edit) {
    const std::vector<std::string> before = texts();
    COMRAD_TRY(edit(config));
    note_changes(before, name);
    return {};
  }

 private:
  std::vector<std::string> texts() const;
  void note_changes(const std::vector<std::string>& before, const std::string& name);
};

/// Applies each layer once on top of `lowest`, whose values are those of the layer `lowest_name`. Errors: those of apply_layer().
Expected<LayeredConfig> merge(const RunConfig& lowest, const std::string& lowest_name,
                              std::span<const NamedLayer> layers);

/// The name of a setting that `key` means, which may be an old one; `key` itself where it is unknown.
std::string canonical_setting(const std::string& key);

/// Of a layer the values of some settings.
SettingsLayer only(const SettingsLayer& layer, std::span<const std::string_view> settings);

}  // namespace comrad::deploy
