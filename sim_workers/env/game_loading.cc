// From names to a game: scenario, WAD, level, actor types, rules. Everything that can be wrong about them is
// an error here, and nothing is later.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/reward_weights.h"
#include "scenarios/spec/action_heads.h"
#include "scenarios/spec/scenario_files.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/env/game_content.h"

namespace comrad::sim {
namespace {

Error bad_input(std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; }

/// The WAD's description of itself; a foreign WAD has none, and the rules use their defaults.
Expected<scenarios::LayoutInfo> read_layout_info(const wad::WadFile& wad, const std::string& scenario) {
  scenarios::LayoutInfo info;
  info.scenario = scenario;
  const std::optional<std::size_t> lump = wad.find(scenarios::kLayoutInfoLump);
  if (!lump) return info;
  Expected<scenarios::LayoutInfo> parsed = scenarios::parse_layout_info(wad.text(*lump));
  if (!parsed) return Error{parsed.error().code, wad.path() + ": " + parsed.error().message};
  COMRAD_TRY(scenarios::check_scenario(*parsed, scenario, wad.path()));
  return parsed;
}

/// What messages call the WAD at `path`. A run plays its own copy of a map that a scenario brings along; messages name
/// that file in the scenario's folder, as long as both are the same.
std::string name_for_messages(const std::string& path, const scenarios::ScenarioSpec& spec) {
  if (spec.wad.empty()) return path;
  const std::string original = spec.folder + "/" + spec.wad;
  const auto copied = scenarios::read_scenario_file(path), brought = scenarios::read_scenario_file(original);
  return copied && brought && *copied == *brought ? original : path;
}

/// What messages call the WAD's DECORATE lump: the scenario's actors.decorate where that is what it holds.
std::string decorate_name(const wad::WadFile& wad, const scenarios::ScenarioSpec& spec) {
  const std::string original = spec.folder + "/actors.decorate";
  const std::optional<std::size_t> lump = wad.find("DECORATE");
  if (!lump || !scenarios::scenario_file_exists(original)) return wad.path() + " DECORATE";
  const auto text = scenarios::read_scenario_file(original);
  return text && *text == wad.text(*lump) ? original : wad.path() + " DECORATE";
}

/// Hash of the whole file's lumps in order: the same for the same layout wherever it lies.
uint64_t layout_id(const wad::WadFile& wad) {
  uint64_t hash = 0;
  for (std::size_t i = 0; i < wad.lump_count(); ++i)
    hash = mix64(hash ^ doomgen::content_hash(wad.lump(i).name) ^ mix64(doomgen::content_hash(wad.text(i))));
  return hash;
}

}  // namespace

Expected<std::shared_ptr<LayoutLibrary>> LayoutLibrary::create(const EnvironmentOptions& options) {
  std::shared_ptr<LayoutLibrary> library(new LayoutLibrary(options));
  if (const auto first = library->game(0); !first) return first.error();
  return library;
}

Expected<std::shared_ptr<const DoomGame>> LayoutLibrary::game(int layout_index) {
  if (layout_index < 0 || layout_index >= size())
    return bad_input(fmt::format("layout {} was requested; the pool has {}", layout_index, size()));
  ++clock_;
  if (const auto kept = games_.find(layout_index); kept != games_.end()) {
    kept->second.asked = clock_;
    return kept->second.game;
  }
  EnvironmentOptions options = options_;
  options.wad_path = options_.layouts[static_cast<std::size_t>(layout_index)];
  COMRAD_TRY_ASSIGN(std::shared_ptr<const DoomGame> game, load_doom_game(options));
  if (renderer_ != nullptr) COMRAD_TRY(renderer_->prepare(game->level, game->catalog));
  if (games_.size() >= kGamesKept)
    games_.erase(std::min_element(games_.begin(), games_.end(), [](const auto& a, const auto& b) {
      return a.second.asked < b.second.asked;
    }));
  games_[layout_index] = {game, clock_};
  return game;
}

Expected<std::shared_ptr<const DoomGame>> load_doom_game(const EnvironmentOptions& options) {
  COMRAD_TRY_ASSIGN(scenarios::ScenarioSpec spec, scenarios::load_scenario(options.scenario));
  COMRAD_TRY_ASSIGN(const wad::WadFile wad,
                    wad::WadFile::open(options.wad_path, name_for_messages(options.wad_path, spec)));
  return load_doom_game(options, std::move(spec), wad);
}

Expected<std::shared_ptr<const DoomGame>> load_doom_game(const EnvironmentOptions& options,
                                                         const wad::WadFile& wad) {
  COMRAD_TRY_ASSIGN(scenarios::ScenarioSpec spec, scenarios::load_scenario(options.scenario));
  return load_doom_game(options, std::move(spec), wad);
}

Expected<std::shared_ptr<const DoomGame>> load_doom_game(const EnvironmentOptions& options,
                                                         scenarios::ScenarioSpec spec,
                                                         const wad::WadFile& wad) {
  auto game = std::make_shared<DoomGame>();
  game->spec = std::move(spec);
  COMRAD_TRY_ASSIGN(const auto weights, parse_reward_weights(options.reward));
  COMRAD_TRY(scenarios::change_weights(game->spec, weights));
  COMRAD_TRY(scenarios::change_heads(game->spec, options.heads));
  const std::vector<int>& supported = game->spec.supported_agents;
  if (std::count(supported.begin(), supported.end(), options.num_agents) == 0)
    return bad_input(fmt::format("scenario {} is not for {} agents; num_agents may be {}", options.scenario,
                                 options.num_agents, joined(supported)));
  if (options.frame_skip < 1 || options.frame_skip > 100)
    return bad_input(fmt::format("env_frameskip is {}; it must lie in 1..100", options.frame_skip));
  if (options.decision_limit > 0)
    game->spec.rules.timeout_tics = static_cast<int>(
        std::min<int64_t>(scenarios::kEngineLimitTics, options.decision_limit * options.frame_skip));
  for (const scenarios::NamedNumber& one : game->spec.globals) {
    COMRAD_TRY_ASSIGN(const int user, game->spec.global_number(one.name));
    game->globals.emplace_back(user, static_cast<int32_t>(one.value));
  }
  game->num_agents = options.num_agents;
  game->frame_skip = options.frame_skip;
  game->use_measurements = options.use_measurements;
  game->use_global_state = options.use_global_state;
  COMRAD_TRY_ASSIGN(game->actions, ActionMap::create(game->spec.heads));

  // Of several players that may respawn, each does, as ViZDoom's multiplayer programs have it.
  game->spec.respawn |= game->spec.rules.lone_death_ends && options.num_agents > 1;

  if (!game->spec.is_vizdoom) {  // a cfg may play any map
    COMRAD_TRY_ASSIGN(game->layout, read_layout_info(wad, game->spec.maps_of));
    if (game->layout.version != game->spec.maps_version && !game->layout.parameters.empty()) {
      spdlog::warn(
          "{} was drawn for version {} of scenario {}; version {} is played, and its best score there is not "
          "known",
          wad.path(), game->layout.version, game->spec.maps_of, game->spec.maps_version);
      game->layout.ceiling = {{0, 0.0}};  // for no team
    }
  }
  const auto ceiling = game->layout.ceiling.find(options.num_agents);
  game->ceiling = !game->spec.maps_say_ceiling || game->layout.ceiling.empty() ? game->spec.ceiling
                  : ceiling != game->layout.ceiling.end()                      ? ceiling->second
                                                                               : 0.0;
  // The only map of a WAD is played whatever its name: a pool may hold other ones than doom_map names.
  if (const std::vector<std::string> maps = wad.map_names(); maps.size() == 1) game->spec.map = maps[0];
  COMRAD_TRY_ASSIGN(GameContent content,
                    load_game_content(wad, game->spec.map, decorate_name(wad, game->spec)));
  // A map from outside may do without scripts; a generated one without them is a broken build.
  if (content.behavior == nullptr && game->spec.wad.empty())
    return Error{ErrorCode::kUnsupported,
                 wad.path() + ": its map has no scripts (BEHAVIOR), which hold the rules of scenario " +
                     options.scenario};
  for (const std::string& warning : content.warnings) spdlog::warn("{}", warning);
  game->level = std::move(content.level);
  game->catalog = std::move(content.catalog);
  game->behavior = std::move(content.behavior);
  game->layout_id = layout_id(wad);
  int start_count = 0;
  for (int player = 0; player < options.num_agents; ++player)
    start_count += std::any_of(
        game->level->things.begin(), game->level->things.end(),
        [&](const doom::MapThing& thing) { return doom::player_of_start(thing.editor_number) == player; });
  // A player without one begins at a deathmatch start, one each.
  const auto deathmatch_starts = static_cast<int>(std::count_if(
      game->level->things.begin(), game->level->things.end(),
      [](const doom::MapThing& thing) { return thing.editor_number == doom::kDeathmatchStart; }));
  if (start_count + deathmatch_starts < options.num_agents)
    return bad_input(
        fmt::format("{} has starts for {} players ({} of them for deathmatch), not for {}: put things 1 to "
                    "{} or deathmatch starts (thing 11) on the map, or play with fewer",
                    wad.path(), start_count + deathmatch_starts, deathmatch_starts, options.num_agents,
                    options.num_agents));
  return std::shared_ptr<const DoomGame>(std::move(game));
}

}  // namespace comrad::sim
