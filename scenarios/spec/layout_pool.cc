#include "scenarios/spec/layout_pool.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string hex(uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof(text), "%016llx", static_cast<unsigned long long>(value));
  return text;
}

/// Draws that bring nothing new, one after the other, before a recipe counts as exhausted.
constexpr int kFruitlessDraws = 300;

/// Seeds of a pool, one after the other.
class SeedStream {
 public:
  explicit SeedStream(PoolKind kind) : kind_(kind) {}
  uint64_t next() {
    if (kind_ == PoolKind::kEval && held_out_ < std::size(kHeldOutSeeds)) return kHeldOutSeeds[held_out_++];
    while (is_held_out_seed(seed_)) ++seed_;
    return seed_++;
  }

 private:
  PoolKind kind_;
  std::size_t held_out_ = 0;
  uint64_t seed_ = 0;
};

/// One layout of a pool as it is to be drawn: options of the axes by its seed, the choices noted.
LayoutRequest request_of_seed(const std::string& scenario, const LayoutRecipe& recipe,
                              const PoolRequest& request, uint64_t seed,
                              std::vector<std::pair<std::string, std::string>>* choices = nullptr) {
  LayoutRequest one = request.layout;
  one.seed = seed;
  if (!request.vary) return one;
  const auto is_set = [&](const char* name) {
    return std::any_of(request.layout.parameters.begin(), request.layout.parameters.end(),
                       [&](const auto& parameter) { return parameter.first == name; });
  };
  for (const auto& [name, value] : recipe.pool_values)
    if (!is_set(name)) one.parameters.emplace_back(name, std::to_string(value));
  Rng rng(RngKey(seed).split(scenario).split("axes"));
  for (const LayoutAxis& axis : recipe.axes) {
    const auto& option = axis.options[rng.below(static_cast<uint32_t>(axis.options.size()))];
    std::string choice;
    for (const auto& [name, value] : option) {
      if (is_set(name)) continue;
      one.parameters.emplace_back(name, std::to_string(value));
      choice += fmt::format("{}{}={}", (choice.empty() ? "" : " "), name, value);
    }
    if (choices != nullptr && !choice.empty()) choices->emplace_back(axis.name, choice);
  }
  return one;
}

/// A recipe has run out of maps: how many there are, and what gives more.
Error out_of_maps(const std::string& scenario, const LayoutRecipe& recipe, const PoolRequest& request,
                  std::size_t found, const PoolTally& tally) {
  const bool for_evaluation = request.kind == PoolKind::kEval;
  std::string more;
  if (!request.vary)
    more = "leave out --no-vary";
  else if (!request.layout.parameters.empty())
    more = "leave out some of the parameters that were set";
  std::vector<std::string> names;
  for (const LayoutParameter& parameter : recipe.parameters) names.push_back(parameter.name);
  return Error{ErrorCode::kBadInput,
               fmt::format("scenario {}: {} layouts for {} were requested, but {} draws gave only {} "
                           "distinct ones ({} draws belong to {}, {} were repetitions). For more, {}give "
                           "other values with --set NAME=VALUE: {}; or draw fewer with --count",
                           scenario, request.count, (for_evaluation ? "evaluation" : "training"), tally.draws,
                           found, tally.other_pool, (for_evaluation ? "training" : "evaluation"),
                           tally.repeated, (more.empty() ? "" : more + ", or "), joined(names))};
}

/// Makes a pool's folder without a registry, which is written when all files are there. Gives its path.
Expected<std::string> begin_pool(const std::string& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Error{ErrorCode::kSystem, folder + ": cannot be made: " + error.message()};
  const std::string registry = (fs::path(folder) / kPoolRegistryName).string();
  fs::remove(registry, error);
  return registry;
}

/// The scenario's name for files: the folder's where the scenario is named by a path.
std::string file_stem(std::string scenario) {
  while (scenario.size() > 1 && scenario.back() == '/') scenario.pop_back();
  return fs::path(scenario).filename().string();
}

/// What is wrong with one layout for this use; empty: nothing. The entry learns its ceilings from its file,
/// `contents` gets its content; `splits` are those of the scenarios met so far. `version` is the scenario's; a map that was drawn
/// for another version has its ceilings, which are computed again.
Status check_entry(PoolEntry& entry, const PoolUse& use, const std::string& scenario, int version,
                   std::map<uint64_t, std::string>& contents, std::map<std::string, ContentSplit>& splits) {
  const std::string where = entry.id + " (" + entry.filename + "): ";
  const auto bad = [&](ErrorCode code, const std::string& what) { return Error{code, where + what}; };
  Expected<std::string> bytes = read_scenario_file(entry.filename);
  if (!bytes) return bad(bytes.error().code, "cannot be read; draw the pool again or correct its registry");
  if (entry.content_hash != 0 && doomgen::content_hash(*bytes) != entry.content_hash)
    return bad(ErrorCode::kBadFormat, "is not the file that " + std::string(kPoolRegistryName) +
                                          " names (content_hash differs); draw the pool again");
  const auto wad = wad::WadFile::from_bytes({bytes->begin(), bytes->end()}, entry.filename);
  if (!wad) return bad(wad.error().code, wad.error().message);
  LayoutInfo info = entry.info;
  const bool is_ours = wad->find(kLayoutInfoLump).has_value();
  if (const auto lump = wad->find(kLayoutInfoLump)) {
    const Expected<LayoutInfo> parsed = parse_layout_info(wad->text(*lump));
    if (!parsed) return bad(parsed.error().code, parsed.error().message);
    info = *parsed;
  }
  if (!scenario.empty() && !info.scenario.empty() && info.scenario != scenario)
    return bad(ErrorCode::kBadInput, "is a map of scenario " + info.scenario + ", not of " + scenario);
  if (use.for_training && entry.split == "eval")
    return bad(ErrorCode::kBadInput,
               "is a layout for evaluation; train on a pool of `comrad doomgen NAME --pool train`, or on "
               "--layout_pool train:<count>");
  entry.info.ceiling = info.ceiling;
  const bool says_ceilings = !info.ceiling.empty() && (scenario.empty() || info.version == version);
  if (!says_ceilings && !info.parameters.empty())
    if (const auto ceilings = layout_ceilings(info.scenario, info.parameters)) entry.info.ceiling = *ceilings;
  if (is_ours) {
    const Expected<uint64_t> content = layout_content(*wad);
    if (!content) return bad(content.error().code, content.error().message);
    if (entry.map_hash != 0 && entry.map_hash != *content)
      return bad(ErrorCode::kBadFormat, "its map is not the one that " + std::string(kPoolRegistryName) +
                                            " names (map_hash differs); draw the pool again");
    const auto [same, is_new] = contents.emplace(*content, entry.id);
    if (!is_new && !entry.split.empty() && entry.stage.empty())
      return bad(ErrorCode::kBadFormat,
                 "is the same map as " + same->second + ", but for its seed; draw the pool again");
    if (use.for_training && !splits.contains(info.scenario)) {
      COMRAD_TRY_ASSIGN(splits[info.scenario], ContentSplit::of(info.scenario));
    }
    if (use.for_training && splits[info.scenario].is_for_evaluation(*content))
      return bad(
          ErrorCode::kBadInput,
          std::string("is for evaluation: its map is a held-out one, or its content is among the one in "
                      "ten that `comrad doomgen NAME --pool eval` draws") +
              (entry.split == "train" ? " (the pool was drawn by an older version, which looked at seeds "
                                        "alone; draw it again)"
                                      : "") +
              ". Train on a pool of `--pool train`, on --layout_pool train:<count>, or on a grid drawn "
              "with --for train");
  }
  if (use.num_agents == 0) return {};
  const std::vector<std::string> names = wad->map_names();
  if (names.empty()) return bad(ErrorCode::kBadFormat, "there is no map in it");
  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad->find_map(names[0]));
  COMRAD_TRY_ASSIGN(const wad::UdmfMap map,
                    lumps.textmap ? wad::parse_udmf(wad->text(*lumps.textmap), where + "TEXTMAP")
                                  : wad::read_binary_map(*wad, lumps, where + names[0]));
  std::set<int> starts;
  for (const wad::UdmfThing& thing : map.things) {
    if (thing.type >= 1 && thing.type <= 4) starts.insert(thing.type);
    if (thing.type >= 4001 && thing.type <= 4004) starts.insert(thing.type - 3996);
  }
  for (int player = 1; player <= use.num_agents; ++player)
    if (!starts.contains(player))
      return bad(ErrorCode::kBadInput,
                 fmt::format("has no start for player {} of {}; draw the pool with --num_agents {}", player,
                             use.num_agents, use.num_agents));
  if (!entry.info.ceiling.empty() && !entry.info.ceiling.contains(use.num_agents))
    return bad(ErrorCode::kBadInput,
               fmt::format("has not enough for {} agents to solve it; draw the pool with --num_agents {}",
                           use.num_agents, use.num_agents));
  return {};
}

}  // namespace

Expected<std::vector<PoolEntry>> make_curriculum_pool(const std::string& scenario,
                                                      const LayoutRequest& request,
                                                      const std::string& folder) {
  COMRAD_TRY_ASSIGN(const LayoutRecipe recipe, layout_recipe(scenario));
  if (recipe.curriculum.stages.empty()) {
    std::vector<std::string> known = layout_recipes();
    std::erase_if(known,
                  [](const std::string& name) { return layout_recipe(name)->curriculum.stages.empty(); });
    return Error{ErrorCode::kBadInput,
                 "scenario " + scenario + " comes with no curriculum; these do: " + joined(known)};
  }
  COMRAD_TRY_ASSIGN(const std::string registry, begin_pool(folder));
  const std::string stem = file_stem(scenario);
  std::vector<PoolEntry> entries;
  Json graph = Json::object();
  for (std::size_t i = 0; i < recipe.curriculum.stages.size(); ++i) {
    const CurriculumStage& stage = recipe.curriculum.stages[i];
    COMRAD_TRY_ASSIGN(const GeneratedLayout layout,
                      generate_layout(scenario, stage_request(recipe.curriculum, stage, request)));
    char number[24];
    std::snprintf(number, sizeof(number), "%02zu", i);
    PoolEntry entry;
    entry.id = stem + "_" + number + "_" + stage.name;
    entry.filename = entry.id + ".wad";
    entry.content_hash = layout.content_hash;
    entry.map_hash = layout.map_hash;
    entry.info = layout.info;
    entry.retries = layout.info.attempt;
    entry.stage = stage.name;
    const auto& ceilings = layout.info.ceiling;
    const auto ceiling = request.num_agents > 0 ? ceilings.find(request.num_agents) : ceilings.begin();
    if (ceiling != ceilings.end()) entry.metric_scale = ceiling->second;
    COMRAD_TRY(
        write_file_atomically((fs::path(folder) / entry.filename).string(), layout.wad, /*durable=*/false));
    entries.push_back(std::move(entry));
  }
  for (std::size_t i = 0; i < entries.size(); ++i)
    for (std::size_t other = 0; other < entries.size(); ++other)
      graph[entries[i].id][entries[other].id] = other > i;
  COMRAD_TRY(write_file_atomically((fs::path(folder) / kInterestingnessName).string(), graph.dump(1) + "\n",
                                   /*durable=*/true));
  COMRAD_TRY(
      write_file_atomically(registry, pool_registry_text(PoolKind::kCurriculum, entries), /*durable=*/true));
  return entries;
}

Expected<std::vector<PoolEntry>> make_grid_pool(const std::string& scenario, const GridRequest& request,
                                                const std::string& folder) {
  COMRAD_TRY_ASSIGN(const LayoutRecipe recipe, layout_recipe(scenario));
  std::vector<GridRequest::Axis> axes = request.axes;
  if (axes.empty())
    for (const LayoutAxis& axis : recipe.axes) {
      GridRequest::Axis& own = axes.emplace_back(GridRequest::Axis{axis.name});
      for (const auto& option : axis.options) own.options.emplace_back(option.begin(), option.end());
    }
  int64_t product = 1;
  std::set<std::string> set_by;
  for (const GridRequest::Axis& axis : axes) {
    if (axis.options.empty()) return Error{ErrorCode::kBadInput, "axis " + axis.name + " has no options"};
    product = std::min<int64_t>(product * static_cast<int64_t>(axis.options.size()), int64_t{1} << 40);
    for (const auto& [name, value] : axis.options[0])
      if (!set_by.insert(name).second) return Error{ErrorCode::kBadInput, "two axes of the grid set " + name};
  }
  const int64_t end = std::min(product, request.start + std::min<int64_t>(request.limit, 100'000));
  if (request.start < 0 || request.start >= end)
    return Error{ErrorCode::kBadInput,
                 fmt::format("the grid has {} layouts; nothing is left from {} on", product, request.start)};
  COMRAD_TRY_ASSIGN(const std::string registry, begin_pool(folder));
  ContentSplit split;
  if (request.for_training) {
    COMRAD_TRY_ASSIGN(split, ContentSplit::of(scenario));
  }
  const std::string stem = file_stem(scenario);
  std::vector<PoolEntry> entries;
  for (int64_t place = request.start; place < end; ++place) {
    LayoutRequest one = request.layout;
    PoolEntry entry;
    int64_t rest = place;
    for (auto axis = axes.rbegin(); axis != axes.rend(); ++axis) {  // the last one turns fastest
      const auto count = static_cast<int64_t>(axis->options.size());
      std::string choice;
      for (const auto& [name, value] : axis->options[static_cast<std::size_t>(rest % count)]) {
        choice += fmt::format("{}{}={}", (choice.empty() ? "" : " "), name, value);
        if (name != "seed")
          one.parameters.emplace_back(name, std::to_string(value));
        else if (value < 0)
          return Error{ErrorCode::kBadInput, fmt::format("seed is {}; it must not be negative", value)};
        else
          one.seed = static_cast<uint64_t>(value);
      }
      entry.axis_choices.insert(entry.axis_choices.begin(), {axis->name, choice});
      rest /= count;
    }
    const Expected<GeneratedLayout> drawn = generate_layout(scenario, one);
    if (!drawn) {
      if (drawn.error().code != ErrorCode::kUnsupported) return drawn.error();
      if (request.left_out) request.left_out(place, drawn.error());
      if (place + 1 == end && entries.empty()) return drawn.error();
      continue;
    }
    const GeneratedLayout& layout = *drawn;
    if (request.for_training && split.is_for_evaluation(layout.map_hash)) continue;
    char number[24];
    std::snprintf(number, sizeof(number), "%04lld", static_cast<long long>(place));
    entry.id = stem + "_" + number;
    entry.filename = entry.id + ".wad";
    entry.content_hash = layout.content_hash;
    entry.map_hash = layout.map_hash;
    entry.info = layout.info;
    entry.retries = layout.info.attempt;
    COMRAD_TRY(
        write_file_atomically((fs::path(folder) / entry.filename).string(), layout.wad, /*durable=*/false));
    entries.push_back(std::move(entry));
  }
  COMRAD_TRY(write_file_atomically(registry, pool_registry_text(PoolKind::kGrid, entries), /*durable=*/true));
  return entries;
}

Expected<LayoutList> check_pool(const std::string& folder, const PoolUse& use) {
  std::string scenario;
  int default_agents = 0, version = 1;
  double own_ceiling = 0;  // of maps that say nothing themselves
  bool maps_say_ceiling = true;
  if (!use.scenario.empty()) {
    COMRAD_TRY_ASSIGN(const ScenarioSpec spec, load_scenario(use.scenario));
    scenario = spec.maps_of;
    version = spec.maps_version;
    default_agents = spec.default_agents;
    own_ceiling = spec.ceiling;
    maps_say_ceiling = spec.maps_say_ceiling;
  }
  COMRAD_TRY_ASSIGN(std::vector<PoolEntry> entries, read_pool(folder));
  LayoutList list;
  std::set<std::string> ids;
  std::map<uint64_t, std::string> contents;
  std::map<std::string, ContentSplit> splits;
  std::error_code error;
  for (PoolEntry& entry : entries) {
    if (!ids.insert(entry.id).second)
      return Error{ErrorCode::kBadFormat, folder + ": two layouts have the id " + entry.id};
    COMRAD_TRY(check_entry(entry, use, scenario, version, contents, splits));
    const auto ceiling = entry.info.ceiling.find(use.num_agents > 0 ? use.num_agents : default_agents);
    list.layouts.push_back(
        {.id = entry.id,
         .path = fs::absolute(entry.filename, error).lexically_normal().string(),
         .metric_scale = entry.metric_scale,
         .ceiling = maps_say_ceiling && ceiling != entry.info.ceiling.end() ? ceiling->second : own_ceiling});
  }
  const fs::path graph = fs::path(folder) / kInterestingnessName;
  if (scenario_file_exists(graph.string()))
    list.interestingness_graph = fs::absolute(graph, error).lexically_normal().string();
  return list;
}

Expected<std::vector<PoolEntry>> make_pool(const std::string& scenario, const PoolRequest& request,
                                           const std::string& folder,
                                           const std::function<void(const PoolEntry&)>& progress,
                                           PoolTally* tally) {
  if (request.kind == PoolKind::kCurriculum) return make_curriculum_pool(scenario, request.layout, folder);
  if (request.count < 1 || request.count > 100'000)
    return Error{ErrorCode::kBadInput, fmt::format("a pool has 1..100000 layouts, not {}", request.count)};
  COMRAD_TRY_ASSIGN(const LayoutRecipe recipe, layout_recipe(scenario));
  COMRAD_TRY_ASSIGN(const ContentSplit split, ContentSplit::of(scenario));
  COMRAD_TRY_ASSIGN(const std::string registry, begin_pool(folder));
  const std::string stem = file_stem(scenario);
  SeedStream seeds(request.kind);
  PoolTally counted;
  PoolTally& count = tally == nullptr ? counted : *tally;
  std::vector<PoolEntry> entries;
  std::set<uint64_t> contents;
  std::optional<Error> lacking;
  for (int fruitless = 0; static_cast<int>(entries.size()) < request.count; ++fruitless) {
    if (fruitless == kFruitlessDraws) {
      std::error_code error;  // a folder of WADs would be a pool
      for (const PoolEntry& entry : entries) fs::remove(fs::path(folder) / entry.filename, error);
      if (lacking && count.draws == 0) return *lacking;
      return out_of_maps(scenario, recipe, request, entries.size(), count);
    }
    PoolEntry entry;
    const LayoutRequest one = request_of_seed(scenario, recipe, request, seeds.next(), &entry.axis_choices);
    const Expected<GeneratedLayout> drawn = generate_layout(scenario, one);
    // Options that do not go together, with what the team needs to solve the map, are drawn from the next seed.
    if (!drawn) {
      if (drawn.error().code != ErrorCode::kUnsupported || !request.vary) return drawn.error();
      lacking = drawn.error();
      continue;
    }
    const GeneratedLayout& layout = *drawn;
    ++count.draws;
    if (split.is_for_evaluation(layout.map_hash) != (request.kind == PoolKind::kEval)) {
      ++count.other_pool;
      continue;
    }
    if (!contents.insert(layout.map_hash).second) {
      ++count.repeated;
      continue;
    }
    fruitless = -1;  // the loop counts on
    entry.id = fmt::format("{}_{}", stem, one.seed);
    entry.filename = entry.id + ".wad";
    entry.content_hash = layout.content_hash;
    entry.map_hash = layout.map_hash;
    entry.info = layout.info;
    entry.retries = layout.info.attempt;
    COMRAD_TRY(
        write_file_atomically((fs::path(folder) / entry.filename).string(), layout.wad, /*durable=*/false));
    if (progress) progress(entry);
    entries.push_back(std::move(entry));
  }
  COMRAD_TRY(write_file_atomically(registry, pool_registry_text(request.kind, entries), /*durable=*/true));
  return entries;
}

Expected<DistinctMaps> count_distinct_maps(const std::string& scenario, const PoolRequest& request,
                                           int draws) {
  if (draws < 2 || draws > 100'000)
    return Error{ErrorCode::kBadInput,
                 fmt::format("distinct maps are counted with 2..100000 draws, not {}", draws)};
  COMRAD_TRY_ASSIGN(const LayoutRecipe recipe, layout_recipe(scenario));
  SeedStream seeds(PoolKind::kTrain);
  std::vector<uint64_t> contents;
  for (int lacking = 0; static_cast<int>(contents.size()) < draws;) {
    const LayoutRequest one = request_of_seed(scenario, recipe, request, seeds.next());
    const Expected<GeneratedLayout> layout = generate_layout(scenario, one);
    // As in make_pool(): options that give the team too little are no draw.
    if (!layout) {
      if (layout.error().code != ErrorCode::kUnsupported || !request.vary || ++lacking == kFruitlessDraws)
        return layout.error();
      continue;
    }
    lacking = 0;
    contents.push_back(layout->map_hash);
  }
  return distinct_maps(contents);
}

std::string pool_registry_text(PoolKind kind, const std::vector<PoolEntry>& entries) {
  Json list = Json::array();
  for (const PoolEntry& entry : entries) {
    Json config = Json::object(), choices = Json::object();
    for (const auto& [name, value] : entry.info.parameters) config[name] = value;
    for (const auto& [axis, choice] : entry.axis_choices) choices[axis] = choice;
    list.push_back({{"id", entry.id},
                    {"filename", entry.filename},
                    {"scenario", entry.info.scenario},
                    {"scenario_version", entry.info.version},
                    {"split", kind == PoolKind::kEval   ? "eval"
                              : kind == PoolKind::kGrid ? ""
                                                        : "train"},
                    {"seed", entry.info.seed},
                    {"attempt", entry.info.attempt},
                    {"content_hash", hex(entry.content_hash)},
                    {"map_hash", hex(entry.map_hash)},
                    {"config", config},
                    {"axis_choices", choices}});
    for (const auto& [agents, ceiling] : entry.info.ceiling)
      list.back()["ceiling"][std::to_string(agents)] = ceiling;
    if (entry.stage.empty()) continue;
    list.back()["curriculum_stage"] = entry.stage;
    list.back()["curriculum_metric_scale"] = entry.metric_scale;
  }
  return list.dump(1) + "\n";
}

Expected<std::vector<PoolEntry>> read_pool(const std::string& folder) {
  std::vector<PoolEntry> entries;
  const std::string registry = (fs::path(folder) / kPoolRegistryName).string();
  if (scenario_file_exists(registry)) {
    COMRAD_TRY_ASSIGN(const std::string text, read_scenario_file(registry));
    Json list;
    try {  // nlohmann throws with line and column; nothing of it leaves this block
      list = Json::parse(text);
    } catch (const Json::parse_error& error) {
      return Error{ErrorCode::kBadFormat, registry + ": " + error.what()};
    }
    if (!list.is_array()) return Error{ErrorCode::kBadFormat, registry + ": is no JSON list"};
    for (std::size_t i = 0; i < list.size(); ++i) {
      const Json& one = list[i];
      const std::string where = fmt::format("{}: entry {}", registry, i);
      if (!one.is_object() || !one.contains("id") || !one["id"].is_string() || !one.contains("filename") ||
          !one["filename"].is_string())
        return Error{ErrorCode::kBadFormat, where + " needs the texts 'id' and 'filename'"};
      PoolEntry entry;
      entry.id = one["id"];
      const fs::path file = one["filename"].get<std::string>();
      entry.filename = (file.is_absolute() ? file : fs::path(folder) / file).string();
      if (one.contains("scenario") && one["scenario"].is_string()) entry.info.scenario = one["scenario"];
      if (one.contains("split") && one["split"].is_string()) entry.split = one["split"];
      if (one.contains("curriculum_stage") && one["curriculum_stage"].is_string())
        entry.stage = one["curriculum_stage"];
      if (one.contains("curriculum_metric_scale") && one["curriculum_metric_scale"].is_number())
        entry.metric_scale = one["curriculum_metric_scale"].get<double>();
      if (one.contains("ceiling") && one["ceiling"].is_object())
        for (const auto& [agents, ceiling] : one["ceiling"].items()) {
          int count = 0;
          const auto [end, failure] = std::from_chars(agents.data(), agents.data() + agents.size(), count);
          if (failure != std::errc() || end != agents.data() + agents.size() || !ceiling.is_number() ||
              !(ceiling.get<double>() > 0))
            return Error{ErrorCode::kBadFormat,
                         where + ": 'ceiling' must be an object, number of agents -> the best score"};
          entry.info.ceiling[count] = ceiling.get<double>();
        }
      if (one.contains("scenario_version") && one["scenario_version"].is_number_integer())
        entry.info.version = one["scenario_version"].get<int>();
      if (one.contains("seed") && one["seed"].is_number_integer())
        entry.info.seed = one["seed"].get<uint64_t>();
      if (one.contains("attempt") && one["attempt"].is_number_integer())
        entry.info.attempt = one["attempt"].get<int>();
      if (one.contains("config") && one["config"].is_object())
        for (const auto& [name, value] : one["config"].items())
          if (value.is_number_integer()) entry.info.parameters[name] = value.get<int64_t>();
      if (one.contains("axis_choices") && one["axis_choices"].is_object())
        for (const auto& [axis, choice] : one["axis_choices"].items())
          if (choice.is_string()) entry.axis_choices.emplace_back(axis, choice.get<std::string>());
      for (const auto& [name, hash] :
           {std::pair{"content_hash", &entry.content_hash}, std::pair{"map_hash", &entry.map_hash}})
        if (one.contains(name) && one[name].is_string()) {
          const std::string digits = one[name];
          std::from_chars(digits.data(), digits.data() + digits.size(), *hash, 16);
        }
      entries.push_back(std::move(entry));
    }
  } else {
    std::error_code error;
    for (const auto& file : fs::directory_iterator(folder, error))
      if (file.path().extension() == ".wad")
        entries.push_back({.id = file.path().stem().string(),
                           .filename = file.path().string(),
                           .info = {},
                           .axis_choices = {}});
    if (error) return Error{ErrorCode::kNotFound, folder + ": " + error.message()};
    std::sort(entries.begin(), entries.end(),
              [](const PoolEntry& a, const PoolEntry& b) { return a.id < b.id; });
  }
  if (entries.empty()) return Error{ErrorCode::kNotFound, folder + ": the pool is empty"};
  return entries;
}

}  // namespace comrad::scenarios
