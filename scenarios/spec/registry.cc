#include "scenarios/spec/registry.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <map>

#include "doomgen/layout/hexen_writer.h"
#include "doomgen/layout/node_builder.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/text.h"
#include "scenarios/spec/layout_content.h"
#include "scenarios/spec/recipe_table.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"
#include "scenarios/spec/script_build.h"

namespace comrad::scenarios {
namespace {

constexpr int kAttempts = 20;
constexpr uint64_t kSeedStep = 1000;
constexpr const char* kMapName = "MAP01";

const RecipeEntry* find_entry(const std::string& scenario) {
  for (const RecipeEntry& entry : recipe_table())
    if (scenario == entry.scenario) return &entry;
  return nullptr;
}

/// The recipe that draws a scenario's maps; null where it brings a map along or this build has none.
const RecipeEntry* entry_of(const ScenarioSpec& spec) {
  return spec.wad.empty() ? find_entry(spec.maps_of) : nullptr;
}

/// The scenario whose maps `scenario` plays: itself, or the base of its base's base.
Expected<ScenarioSpec> load_map_owner(const std::string& scenario) {
  COMRAD_TRY_ASSIGN(ScenarioSpec spec, load_scenario(scenario));
  if (spec.is_vizdoom || spec.maps_of == spec.name) return spec;
  COMRAD_TRY_ASSIGN(ScenarioSpec owner, load_scenario(spec.folder));
  owner.layout = std::move(spec.layout);
  return owner;
}

Expected<int64_t> parse_number(const std::string& name, const std::string& text) {
  int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    return Error{ErrorCode::kBadInput, "layout parameter " + name + ": '" + text + "' is no whole number"};
  return value;
}

/// Those of the recipe, over them what the scenario sets, over them what is requested.
Expected<ParameterValues> parameter_values(const ScenarioSpec& spec, const LayoutRecipe& recipe,
                                           const LayoutRequest& request) {
  ParameterValues values;
  std::vector<std::string> known;
  for (const LayoutParameter& parameter : recipe.parameters) {
    values[parameter.name] = parameter.default_value;
    known.push_back(parameter.name);
  }
  for (const NamedNumber& one : spec.layout) {
    if (!values.contains(one.name))
      return Error{ErrorCode::kBadFormat,
                   one.where + ": [layout]: " +
                       (known.empty() ? "only maps that are drawn have parameters; leave it out beside wad"
                                      : unknown_word("layout parameter", one.name, known))};
    values[one.name] = one.value;
  }
  for (const auto& [name, text] : request.parameters) {
    if (!values.contains(name)) {
      return Error{ErrorCode::kBadInput, "scenario " + spec.name + " has no layout parameter '" + name + "'" +
                                             did_you_mean(name, known)};
    }
    COMRAD_TRY_ASSIGN(values[name], parse_number(name, text));
  }
  // A map prepared for more players serves fewer as well, so the default map is the same for every team size
  // it holds.
  if (recipe.players_parameter != nullptr)
    if (int64_t& players = values[recipe.players_parameter]; players < request.num_agents)
      players = request.num_agents;
  for (const LayoutParameter& parameter : recipe.parameters) {
    const int64_t value = values[parameter.name];
    if (value < parameter.low || value > parameter.high)
      return Error{ErrorCode::kBadInput, fmt::format("layout parameter {} is {}; it must lie in {}..{}",
                                                     parameter.name, value, parameter.low, parameter.high)};
  }
  return values;
}

/// Of each team size that a map of these parameters is enough for. One that it is not enough for is left out, and
/// so are teams of more than `most_agents` (0: any).
std::map<int, double> ceilings_of(const ScenarioSpec& spec, const LayoutRecipe& recipe,
                                  const ParameterValues& values, int most_agents = 0) {
  std::map<int, double> ceilings;
  for (const int agents : spec.supported_agents) {
    if (most_agents > 0 && agents > most_agents) continue;
    const LayoutTask task{values, agents, spec.limit_tics()};
    if (recipe.check_resources != nullptr && !recipe.check_resources(task)) continue;
    const double ceiling =
        recipe.ceiling != nullptr && spec.maps_say_ceiling ? recipe.ceiling(task) : spec.ceiling;
    if (ceiling > 0) ceilings[agents] = ceiling;
  }
  return ceilings;
}

Status check_task(const ScenarioSpec& spec, const LayoutRecipe& recipe, const ParameterValues& values,
                  int num_agents) {
  if (recipe.check_resources == nullptr) return {};
  const LayoutTask task{values, num_agents > 0 ? num_agents : spec.default_agents, spec.limit_tics()};
  const Status enough = recipe.check_resources(task);
  if (enough) return {};
  return Error{ErrorCode::kUnsupported, fmt::format("scenario {} cannot be solved by {} agents: {}",
                                                    spec.name, task.num_agents, enough.error().message)};
}

int start_count(const doomgen::MapData& map) {
  return static_cast<int>(
      std::count_if(map.things.begin(), map.things.end(), [](const doomgen::ThingData& thing) {
        return (thing.editor_number >= 1 && thing.editor_number <= 4) ||
               (thing.editor_number >= 4001 && thing.editor_number <= 4004);
      }));
}

/// Everything that stands around the map: info, actors, pictures, script.
Status write_wad(const ScenarioSpec& spec, const LayoutRequest& request, const DrawnLayout& drawn,
                 GeneratedLayout& layout) {
  doomgen::WadWriter wad;
  COMRAD_TRY(wad.add(kLayoutInfoLump, write_layout_info(layout.info)));
  if (scenario_file_exists(spec.folder + "/actors.decorate")) {
    COMRAD_TRY_ASSIGN(const std::string actors, read_scenario_file(spec.folder + "/actors.decorate"));
    COMRAD_TRY(wad.add("DECORATE", actors));
  }
  for (const NamedBytes& lump : drawn.lumps) COMRAD_TRY(wad.add(lump.name, lump.bytes));
  if (!drawn.textures.empty()) {
    COMRAD_TRY(wad.add("TX_START", {}));
    for (const NamedBytes& texture : drawn.textures) COMRAD_TRY(wad.add(texture.name, texture.bytes));
    COMRAD_TRY(wad.add("TX_END", {}));
  }
  BuiltScript script;
  if (scenario_file_exists(spec.folder + "/script.acs")) {
    COMRAD_TRY_ASSIGN(script, build_script(spec, layout_script_text(layout.info, drawn), drawn.more_scripts));
    layout.warnings.insert(layout.warnings.end(), script.warnings.begin(), script.warnings.end());
  }
  if (request.format == MapFormat::kHexen) {
    COMRAD_TRY_ASSIGN(const doomgen::HexenLumps lumps, doomgen::write_hexen(drawn.map));
    layout.warnings.insert(layout.warnings.end(), lumps.warnings.begin(), lumps.warnings.end());
    COMRAD_TRY(wad.add_hexen_map(kMapName, lumps, script.behavior, script.source));
  } else {
    COMRAD_TRY(wad.add_udmf_map(kMapName, doomgen::write_udmf(drawn.map), script.behavior, script.source));
  }
  COMRAD_TRY_ASSIGN(layout.wad, wad.bytes());
  if (request.nodes) {
    COMRAD_TRY_ASSIGN(layout.wad, doomgen::build_nodes(layout.wad));
  }
  layout.content_hash = doomgen::content_hash(layout.wad);
  COMRAD_TRY_ASSIGN(const wad::WadFile file,
                    wad::WadFile::from_bytes({layout.wad.begin(), layout.wad.end()}, layout.info.scenario));
  COMRAD_TRY_ASSIGN(layout.map_hash, layout_content(file));
  return {};
}

/// A scenario without a recipe brings its map along.
Expected<GeneratedLayout> ready_made(const ScenarioSpec& spec, const LayoutRequest& request) {
  if (!request.parameters.empty())
    return Error{ErrorCode::kBadInput, "scenario " + spec.name + " has its own map (" + spec.wad +
                                           ") and no layout parameter '" + request.parameters[0].first + "'"};
  if (!request.as.empty())
    return Error{ErrorCode::kBadInput, "scenario " + spec.name + " has its own map (" + spec.wad +
                                           "); --as is for maps that are drawn, copy this one"};
  GeneratedLayout layout;
  layout.file = spec.folder + "/" + spec.wad;
  // A cfg without its own WAD plays a map of the IWAD.
  COMRAD_TRY_ASSIGN(layout.wad, read_scenario_file(layout.file, spec.is_vizdoom ? 256 : 16));
  if (!layout.wad.starts_with("PWAD") && !layout.wad.starts_with("IWAD"))
    return Error{ErrorCode::kBadFormat, layout.file + ": is no WAD"};
  // Here rather than in the programs that play a copy of it.
  COMRAD_TRY_ASSIGN(
      const wad::WadFile opened,
      wad::WadFile::from_bytes(std::vector<uint8_t>(layout.wad.begin(), layout.wad.end()), layout.file));
  if (const auto lump = opened.find(kLayoutInfoLump); lump && !spec.is_vizdoom) {
    const Expected<LayoutInfo> info = parse_layout_info(opened.text(*lump));
    if (!info) return Error{info.error().code, layout.file + ": " + info.error().message};
    COMRAD_TRY(check_scenario(*info, spec.name, layout.file));
  }
  layout.info.scenario = spec.name;
  layout.info.seed = request.seed;
  if (request.nodes) {
    COMRAD_TRY_ASSIGN(layout.wad, doomgen::build_nodes(layout.wad));
  }
  layout.content_hash = doomgen::content_hash(layout.wad);
  const auto file = wad::WadFile::from_bytes({layout.wad.begin(), layout.wad.end()}, spec.wad);
  if (const auto content = file ? layout_content(*file) : Expected<uint64_t>(file.error()); content)
    layout.map_hash = *content;
  return layout;
}

}  // namespace

std::vector<std::string> layout_recipes() {
  std::vector<std::string> names;
  for (const RecipeEntry& entry : recipe_table()) names.emplace_back(entry.scenario);
  return names;
}

Expected<LayoutRecipe> layout_recipe(const std::string& scenario) {
  if (const RecipeEntry* entry = find_entry(scenario)) return entry->recipe();
  if (const Expected<ScenarioSpec> spec = load_scenario(scenario))
    if (const RecipeEntry* entry = entry_of(*spec)) return entry->recipe();
  return Error{ErrorCode::kNotFound, "there is no layout recipe for scenario '" + scenario +
                                         "'; known: " + joined(layout_recipes())};
}

Expected<std::vector<LayoutParameter>> layout_parameters(const std::string& scenario) {
  COMRAD_TRY_ASSIGN(LayoutRecipe recipe, layout_recipe(scenario));
  return std::move(recipe.parameters);
}

Expected<std::map<int, double>> layout_ceilings(const std::string& scenario, const ParameterValues& values) {
  COMRAD_TRY_ASSIGN(const LayoutRecipe recipe, layout_recipe(scenario));
  COMRAD_TRY_ASSIGN(const ScenarioSpec spec, load_scenario(scenario));
  ParameterValues all = values;
  for (const LayoutParameter& parameter : recipe.parameters)
    all.try_emplace(parameter.name, parameter.default_value);
  return ceilings_of(spec, recipe, all);
}

Expected<std::map<int, double>> default_ceilings(const ScenarioSpec& spec) {
  const RecipeEntry* const entry = entry_of(spec);
  const LayoutRecipe recipe = entry != nullptr ? entry->recipe() : LayoutRecipe{};
  COMRAD_TRY_ASSIGN(const ParameterValues values, parameter_values(spec, recipe, {}));
  return ceilings_of(spec, recipe, values);
}

Status check_resources(const std::string& scenario, const LayoutRequest& request) {
  COMRAD_TRY_ASSIGN(const ScenarioSpec spec, load_scenario(scenario));
  const RecipeEntry* const entry = entry_of(spec);
  if (entry == nullptr) return {};
  const LayoutRecipe recipe = entry->recipe();
  COMRAD_TRY_ASSIGN(const ParameterValues values, parameter_values(spec, recipe, request));
  return check_task(spec, recipe, values, request.num_agents);
}

std::string layout_script_text(const LayoutInfo& info, const DrawnLayout& layout) {
  std::string text = kLayoutScriptHead + info.scenario + ", made by comrad doomgen.\n";
  const auto define = [&](const std::string& name, int64_t value) {
    text += fmt::format("#define {} {}\n", name, value);
  };
  define("LAYOUT_SEED", static_cast<int64_t>(info.seed & 0x7FFFFFFF));
  define("LAYOUT_PLAYERS", start_count(layout.map));
  for (const auto& [name, value] : info.parameters) define("PARAM_" + upper_case(name), value);
  for (const auto& [name, value] : layout.defines) define(name, value);
  for (const auto& [name, values] : layout.arrays) {
    text += fmt::format("int {}[{}] = {{{}}};\n", name, std::max<std::size_t>(1, values.size()),
                        (values.empty() ? "0" : joined(values)));
  }
  return text;
}

LayoutRequest stage_request(const CurriculumRecipe& curriculum, const CurriculumStage& stage,
                            const LayoutRequest& base) {
  LayoutRequest request = base;
  request.seed = stage.seed;
  request.parameters.clear();
  for (std::size_t i = 0; i < stage.values.size(); ++i)
    request.parameters.emplace_back(curriculum.parameters[i], std::to_string(stage.values[i]));
  return request;
}

Expected<GeneratedLayout> generate_layout(const std::string& named, const LayoutRequest& request) {
  if (!names_vizdoom_config(named) && !find_scenario_folder(named)) return layout_recipe(named).error();
  COMRAD_TRY_ASSIGN(const ScenarioSpec spec, load_map_owner(named));
  const std::string& scenario = spec.name;
  const RecipeEntry* const entry = entry_of(spec);
  if (entry == nullptr) {
    if (spec.wad.empty())
      return Error{ErrorCode::kNotFound, "scenario " + spec.name +
                                             " has neither a layout recipe in this build nor a "
                                             "'wad' in " +
                                             spec.folder + "/scenario.toml"};
    return ready_made(spec, request);
  }
  const LayoutRecipe recipe = entry->recipe();
  COMRAD_TRY_ASSIGN(const ParameterValues values, parameter_values(spec, recipe, request));
  COMRAD_TRY(check_task(spec, recipe, values, request.num_agents));
  GeneratedLayout layout;
  const int team = request.num_agents > 0 ? request.num_agents : spec.default_agents;
  bool only_room_lacks = true;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const uint64_t seed = request.seed + kSeedStep * attempt;
    const Expected<DrawnLayout> drawn =
        recipe.draw({seed, values, RngKey(seed).split(scenario), request.num_agents});
    if (!drawn) {
      layout.refusals.push_back(fmt::format("seed {}: {}", seed, drawn.error().message));
      only_room_lacks = false;
      continue;
    }
    if (drawn->most_agents > 0 && drawn->most_agents < team) {
      layout.refusals.push_back(fmt::format("seed {}: {}: there is room for {} agents, not for {}", seed,
                                            scenario, drawn->most_agents, team));
      continue;
    }
    if (const int starts = start_count(drawn->map); starts < request.num_agents)
      return Error{ErrorCode::kBadInput,
                   fmt::format("scenario {}: its map has starts for {} players, not for {}", scenario, starts,
                               request.num_agents)};
    layout.info = {
        request.as.empty() ? scenario : request.as, request.seed, spec.version, attempt, values,
        // Another scenario pays for something else: its own ceiling holds.
        request.as.empty() ? ceilings_of(spec, recipe, values, drawn->most_agents) : std::map<int, double>{}};
    for (const LayoutParameter& parameter : recipe.parameters)
      if (parameter.hide_default && values.at(parameter.name) == parameter.default_value)
        layout.info.parameters.erase(parameter.name);
    COMRAD_TRY(write_wad(spec, request, *drawn, layout));
    return layout;
  }
  return Error{
      only_room_lacks ? ErrorCode::kUnsupported : ErrorCode::kBadInput,
      fmt::format(
          "scenario {}: none of {} attempts from seed {} gave a valid map; the last one failed because {}",
          scenario, kAttempts, request.seed, layout.refusals.back())};
}

}  // namespace comrad::scenarios
