// How a scenario draws its maps: a folder with a layout.cc declares `LayoutRecipe recipe()` in its own
// namespace (scenarios/<name>/layout.h), and CMake collects the folders. A recipe is a pure function of seed
// and parameters; the frame (registry.h) retries refused seeds, compiles the script and writes the WAD.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_data.h"
#include "doomgen/layout/map_plan.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::scenarios {

/// One parameter of a recipe; all are whole numbers (densities in thousandths).
struct LayoutParameter {
  const char* name;
  int64_t default_value, low, high;
  const char* help;
  /// Not written into WADs where it has its default value, so that maps drawn before there was such a
  /// parameter keep their bytes; script.acs may not name it.
  bool hide_default = false;
};

/// One axis of a layout pool: each option sets one or more parameters. Axes do not share parameters.
struct LayoutAxis {
  const char* name;
  std::vector<std::vector<std::pair<const char*, int64_t>>> options;
};

/// One stage of a curriculum.
struct CurriculumStage {
  const char* name;
  uint64_t seed;
  /// In the order of CurriculumRecipe::parameters, one for each, over the recipe's defaults; empty: the default map.
  std::vector<int64_t> values;
};

/// The curriculum that comes with a scenario, published with it or our own. Scores of a stage are compared with those
/// of others by the ceiling of its map.
struct CurriculumRecipe {
  std::vector<const char*> parameters;
  std::vector<CurriculumStage> stages = {};  ///< from easy to hard
};

using ParameterValues = std::map<std::string, int64_t>;

/// One attempt at a map.
struct LayoutDraw {
  uint64_t seed = 42;
  ParameterValues values;  ///< every parameter of the recipe
  RngKey key{0};  ///< of this scenario and seed; split it for every purpose: Rng(draw.key.split("pillars"))
  int num_agents = 0;  ///< agents that must find a start; 0: as many as the recipe prepares

  /// A parameter's value; its name must be one of the recipe's.
  int64_t value(const std::string& name) const { return values.at(name); }
  int32_t value32(const std::string& name) const { return static_cast<int32_t>(values.at(name)); }
};

/// A team before a map of some parameters.
struct LayoutTask {
  const ParameterValues& values;  ///< every parameter of the recipe
  int num_agents = 2;
  int32_t limit_tics = 0;  ///< when episodes are cut off

  int64_t value(const std::string& name) const { return values.at(name); }
};

/// A lump beside the map.
struct NamedBytes {
  std::string name, bytes;
};

/// What a recipe draws.
struct DrawnLayout {
  doomgen::MapData map;
  /// `#define NAME value` for script.acs, besides PARAM_<NAME> for every parameter, LAYOUT_PLAYERS (starts on
  /// the map) and LAYOUT_SEED, which makes no other map of it (layout_content.h).
  std::vector<std::pair<std::string, int64_t>> defines = {};
  /// `int name[] = {...}` for script.acs.
  std::vector<std::pair<std::string, std::vector<int64_t>>> arrays = {};
  /// Files beside script.acs that are compiled behind it, for what only some maps have.
  std::vector<std::string> more_scripts = {};
  std::vector<NamedBytes> textures = {};  ///< PNG or patch lumps between TX_START and TX_END
  std::vector<NamedBytes> lumps = {};     ///< any others, as they are
  int most_agents = 0;  ///< the largest team that this map has room for; 0: the parameters decide alone
};

/// How to draw one scenario's maps.
struct LayoutRecipe {
  std::vector<LayoutParameter> parameters;
  /// One attempt; an error (of the map's own checks, of the scenario's rules) means "next seed".
  Expected<DrawnLayout> (*draw)(const LayoutDraw& draw) = nullptr;
  const char* players_parameter = nullptr;  ///< which parameter sets how many starts the map has, if any
  std::vector<LayoutAxis> axes = {};
  /// What pools that vary set beside their axes. Grids, single maps and published maps keep the defaults.
  std::vector<std::pair<const char*, int64_t>> pool_values = {};
  CurriculumRecipe curriculum = {};  ///< `comrad doomgen NAME --pool curriculum`
  /// The best score J that such a map allows: an upper bound by the rules, above which no episode ends.
  /// None: the ceiling of scenario.toml, which no parameter and no team size changes.
  double (*ceiling)(const LayoutTask& task) = nullptr;
  /// Whether what the map gives (ammunition, food, ...) suffices to solve it. Errors say what lacks and which
  /// parameters to change; such a map is not made. None: whatever the parameters are, it does.
  Status (*check_resources)(const LayoutTask& task) = nullptr;
};

}  // namespace comrad::scenarios
