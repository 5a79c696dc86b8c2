// Where scenarios lie: the folders below data_dir()/scenarios, those of COMRAD_SCENARIO_PATH, and any folder
// that is named by its path.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::scenarios {

/// A scenario and one of its variants: "stag_hunt_arena@reference". The variant is empty where none is named, and of "@default".
struct ScenarioName {
  std::string scenario, variant;
};
ScenarioName split_variant(const std::string& name);

/// The file of a variant of the scenario in `folder`. Errors: kNotFound with the nearest and all known variants.
Expected<std::string> find_variant_file(const std::string& folder, const std::string& variant);

/// Names of the variants of the scenario in `folder`, sorted; "default" is not among them.
std::vector<std::string> list_variants(const std::string& folder);

/// The folder of a scenario. `name` is a scenario's name, or a path (anything with a '/' in it) of a folder
/// with a scenario.toml; a variant behind it does not count. COMRAD_SCENARIO_PATH, folders of scenarios parted by
/// ':', is searched first. Errors: kNotFound with the nearest and all known names.
Expected<std::string> find_scenario_folder(const std::string& name);

/// A file of a scenario, `most_megabytes` at most. Errors: kSystem, kBadFormat naming the path.
Expected<std::string> read_scenario_file(const std::string& path, std::size_t most_megabytes = 16);

/// True where the file exists.
bool scenario_file_exists(const std::string& path);

}  // namespace comrad::scenarios
