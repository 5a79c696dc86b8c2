#include "scenarios/spec/registry.h"

#include <charconv>
#include <map>

#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "rollout_buffer/core/config.h"
#include "scenarios/coop_health_gathering/layout.h"

namespace comrad::scenarios {
namespace {

using ParameterValues = std::map<std::string, int64_t>;

/// How to draw one scenario's map. `draw` makes one attempt from one seed; an error it returns means "next
/// seed".
struct LayoutRecipe {
  const char* scenario;
  std::vector<LayoutParameter> (*parameters)();
  Expected<doomgen::MapData> (*draw)(uint64_t seed, const ParameterValues& values);
  const char* players_parameter;  ///< how many starts the map has
};

constexpr LayoutRecipe kRecipes[] = {
    {"coop_health_gathering", coop_health_gathering::parameters, coop_health_gathering::draw, "players"},
};

constexpr int kAttempts = 20;
constexpr uint64_t kSeedStep = 1000;

Expected<const LayoutRecipe*> find_recipe(const std::string& scenario) {
  for (const LayoutRecipe& recipe : kRecipes)
    if (scenario == recipe.scenario) return &recipe;
  std::string known;
  for (const std::string& name : layout_recipes()) known += (known.empty() ? "" : ", ") + name;
  return Error{ErrorCode::kNotFound,
               "there is no layout recipe for scenario '" + scenario + "'; known: " + known};
}

Expected<int64_t> parse_number(const std::string& name, const std::string& text) {
  int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    return Error{ErrorCode::kBadInput, "layout parameter " + name + ": '" + text + "' is no whole number"};
  return value;
}

Expected<ParameterValues> parameter_values(const LayoutRecipe& recipe, const LayoutRequest& request) {
  const std::vector<LayoutParameter> parameters = recipe.parameters();
  ParameterValues values;
  std::vector<std::string> known;
  for (const LayoutParameter& parameter : parameters) {
    values[parameter.name] = parameter.default_value;
    known.push_back(parameter.name);
  }
  for (const auto& [name, text] : request.parameters) {
    if (!values.contains(name)) {
      const std::string near = nearest_word(name, known);
      return Error{ErrorCode::kBadInput, "scenario " + std::string(recipe.scenario) +
                                             " has no layout parameter '" + name + "'" +
                                             (near.empty() ? "" : "; did you mean '" + near + "'?")};
    }
    COMRAD_TRY_ASSIGN(values[name], parse_number(name, text));
  }
  // A map prepared for more players serves fewer as well, so the default map is the same for every team size
  // it holds.
  if (int64_t& players = values[recipe.players_parameter]; players < request.num_agents)
    players = request.num_agents;
  for (const LayoutParameter& parameter : parameters) {
    const int64_t value = values[parameter.name];
    if (value < parameter.low || value > parameter.high)
      return Error{ErrorCode::kBadInput, "layout parameter " + std::string(parameter.name) + " is " +
                                             std::to_string(value) + "; it must lie in " +
                                             std::to_string(parameter.low) + ".." +
                                             std::to_string(parameter.high)};
  }
  return values;
}

}  // namespace

std::vector<std::string> layout_recipes() {
  std::vector<std::string> names;
  for (const LayoutRecipe& recipe : kRecipes) names.emplace_back(recipe.scenario);
  return names;
}

Expected<std::vector<LayoutParameter>> layout_parameters(const std::string& scenario) {
  COMRAD_TRY_ASSIGN(const LayoutRecipe* recipe, find_recipe(scenario));
  return recipe->parameters();
}

Expected<GeneratedLayout> generate_layout(const std::string& scenario, const LayoutRequest& request) {
  COMRAD_TRY_ASSIGN(const LayoutRecipe* recipe, find_recipe(scenario));
  COMRAD_TRY_ASSIGN(const ParameterValues values, parameter_values(*recipe, request));
  std::string reason;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Expected<doomgen::MapData> map = recipe->draw(request.seed + kSeedStep * attempt, values);
    if (!map) {
      reason = map.error().message;
      continue;
    }
    GeneratedLayout layout;
    layout.info = {scenario, request.seed, attempt, values};
    doomgen::WadWriter wad;
    COMRAD_TRY(wad.add(kLayoutInfoLump, write_layout_info(layout.info)));
    COMRAD_TRY(wad.add_udmf_map("MAP01", doomgen::write_udmf(*map)));
    COMRAD_TRY_ASSIGN(layout.wad, wad.bytes());
    layout.content_hash = doomgen::content_hash(layout.wad);
    return layout;
  }
  return Error{ErrorCode::kBadInput, "scenario " + scenario + ": none of " + std::to_string(kAttempts) +
                                         " attempts from seed " + std::to_string(request.seed) +
                                         " gave a valid map; the last one failed because " + reason};
}

}  // namespace comrad::scenarios
