// From a scenario's folder to a finished WAD: finds the recipe, draws until a map is accepted, compiles
// script.acs with the layout's numbers, adds actors.decorate and pictures. All recipes at a glance: the table
// that CMake makes of the folders with a layout.cc.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/layout_info.h"
#include "scenarios/spec/layout_recipe.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

enum class MapFormat { kUdmf, kHexen };

/// What map is wanted.
struct LayoutRequest {
  uint64_t seed = 42;
  int num_agents = 0;  ///< agents that must find a start; 0: as many as the recipe prepares
  /// `--set key=value`, over the recipe's defaults.
  std::vector<std::pair<std::string, std::string>> parameters = {};
  MapFormat format = MapFormat::kUdmf;
  bool nodes = false;   ///< run zdbsp; the bytes then depend on its version
  std::string as = {};  ///< the scenario whose map it claims to be; empty: the one that draws it
};

/// `base` with the seed and the parameters of a stage of `curriculum`.
LayoutRequest stage_request(const CurriculumRecipe& curriculum, const CurriculumStage& stage,
                            const LayoutRequest& base = {});

/// A finished layout.
struct GeneratedLayout {
  std::string wad;            ///< bytes of the file
  uint64_t content_hash = 0;  ///< FNV-1a 64 of them
  uint64_t map_hash = 0;      ///< layout_content() of them; 0 of a ready-made WAD whose map cannot be read
  LayoutInfo info;
  std::string file = {};  ///< of a map that the scenario brings along: where it lies; empty for a drawn one
  std::vector<std::string> refusals = {};  ///< why each attempt before this one was not accepted
  std::vector<std::string> warnings = {};  ///< of the script compiler and the writers
};

/// Names of the scenarios whose maps this build can draw, sorted.
std::vector<std::string> layout_recipes();

/// The recipe of a scenario. Errors: kNotFound naming the known ones.
Expected<LayoutRecipe> layout_recipe(const std::string& scenario);

/// The parameters of a recipe. Errors: kNotFound naming the known recipes.
Expected<std::vector<LayoutParameter>> layout_parameters(const std::string& scenario);

/// The best score J that a map of these parameters allows, by team size (LayoutInfo::ceiling): a recipe's own
/// bound, else the ceiling of scenario.toml. A parameter that `values` lacks has its default.
/// Errors: kNotFound for an unknown recipe; those of load_scenario().
Expected<std::map<int, double>> layout_ceilings(const std::string& scenario, const ParameterValues& values);

/// The same for the recipe's default map, or for the map that the scenario brings along.
Expected<std::map<int, double>> default_ceilings(const ScenarioSpec& spec);

/// Whether a map of `request`'s parameters gives its team (0: the scenario's default one) what it needs; the
/// seed is not read. A scenario without a recipe has nothing to check.
/// Errors: kUnsupported saying what lacks; kBadInput for a parameter that is unknown or out of range.
Status check_resources(const std::string& scenario, const LayoutRequest& request);

/// Makes the WAD of a scenario. `scenario` is a name, or the path of a folder with a scenario.toml. With a
/// recipe: a pure function of its arguments and the folder's files, the same bytes on every machine. Without
/// one: the WAD that scenario.toml names (`wad = "arena.wad"`), as it is. A scenario with a base gets the base's.
/// Errors: kNotFound for an unknown scenario; those of check_resources(); kUnsupported when none of 20 attempts
/// has room for the team, kBadInput when none passes the checks for any other reason (with the last one);
/// kBadFormat of script.acs by file and line.
Expected<GeneratedLayout> generate_layout(const std::string& scenario, const LayoutRequest& request);

/// How layout_script_text() begins.
constexpr const char* kLayoutScriptHead = "// Layout of ";

/// The text that script.acs finds as "layout.acs": seed, parameters, the recipe's own numbers and arrays.
std::string layout_script_text(const LayoutInfo& info, const DrawnLayout& layout);

}  // namespace comrad::scenarios
