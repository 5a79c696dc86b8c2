#include "scenarios/spec/vizdoom_scenario.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>

#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/iwad_search.h"
#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/text.h"
#include "scenarios/spec/action_heads.h"

namespace comrad::scenarios {
namespace {

namespace fs = std::filesystem;

constexpr int kDeathmatchStart = 11;
constexpr int kLongestTimeoutTics = 100'000'000;  ///< 33 days
constexpr const char* kDebianGames = "/usr/share/games/doom/";

std::string at_line(const VizdoomConfig& config, int line) {
  return config.path + (line > 0 ? fmt::format(":{}", line) : "") + ": ";
}

/// About what a variable reaches, for a network.
double scale_of(const GameVariable& variable) {
  switch (variable.kind) {
    case VariableKind::kHealth:
    case VariableKind::kArmor:
    case VariableKind::kSelectedWeaponAmmo:
    case VariableKind::kAmmo:
    case VariableKind::kDamageCount:
    case VariableKind::kDamageTaken:
      return 1.0 / 100;
    case VariableKind::kPositionX:
    case VariableKind::kPositionY:
    case VariableKind::kPositionZ:
    case VariableKind::kCameraPositionX:
    case VariableKind::kCameraPositionY:
    case VariableKind::kCameraPositionZ:
      return 1.0 / 1024;
    case VariableKind::kAngle:
    case VariableKind::kPitch:
    case VariableKind::kRoll:
    case VariableKind::kCameraAngle:
    case VariableKind::kCameraPitch:
    case VariableKind::kCameraRoll:
    case VariableKind::kCameraFov:
      return 1.0 / 180;
    case VariableKind::kVelocityX:
    case VariableKind::kVelocityY:
    case VariableKind::kVelocityZ:
    case VariableKind::kSelectedWeapon:
    case VariableKind::kKillCount:
    case VariableKind::kItemCount:
    case VariableKind::kHitCount:
    case VariableKind::kHitsTaken:
      return 1.0 / 10;
    case VariableKind::kViewHeight:
      return 1.0 / 64;
    default:
      return 1.0;
  }
}

/// The IWAD that doom_game_path names, in its place or by its name among Debian's; empty, with a warning, where there is
/// none: COMRAD's own search then finds one.
std::string game_wad(const VizdoomConfig& config, ScenarioSpec& spec) {
  if (config.game_path.empty()) return {};
  std::error_code ignored;
  for (const std::string& path :
       {existing_file(config.game_path), kDebianGames + fs::path(config.game_path).filename().string()})
    if (fs::is_regular_file(path, ignored)) return path;
  spec.warnings.push_back(at_line(config, config.game_line) + "doom_game_path: there is no " +
                          config.game_path + "; Freedoom 2 or $COMRAD_IWAD is played instead");
  return {};
}

Expected<std::string> map_wad(const VizdoomConfig& config, const std::string& iwad) {
  std::error_code ignored;
  if (config.scenario_path.empty()) {
    Expected<std::string> found = wad::find_iwad(iwad);
    if (!found)
      return Error{found.error().code, config.path +
                                           ": it names no doom_scenario_path, so a map of the IWAD is "
                                           "played: " +
                                           found.error().message};
    return found;
  }
  const std::string path = existing_file(config.scenario_path);
  if (fs::is_regular_file(path, ignored)) return path;
  return Error{ErrorCode::kNotFound, at_line(config, config.scenario_line) +
                                         "doom_scenario_path: there is no " + config.scenario_path +
                                         "; a relative path starts from the folder of the .cfg: put the WAD "
                                         "there, or correct the line"};
}

/// How many players find a start: their own, or one for deathmatch.
Expected<int> most_players(const wad::WadFile& wad, const std::string& map_name) {
  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(map_name));
  const std::string label = wad.path() + " " + map_name;
  Expected<wad::UdmfMap> map = lumps.textmap ? wad::parse_udmf(wad.text(*lumps.textmap), label)
                                             : wad::read_binary_map(wad, lumps, label);
  if (!map) return map.error();
  const auto count = [&](int type) {
    return static_cast<int>(std::ranges::count(map->things, type, &wad::UdmfThing::type));
  };
  int own = 0, most = 0;
  for (int player = 1; player <= kMaxAgents; ++player) {
    own += count(player <= 4 ? player : 4001 + player - 5) > 0;
    if (own + count(kDeathmatchStart) >= player) most = player;
  }
  return most;
}

/// The map of the WAD that is played, and for how many.
Status find_map(const VizdoomConfig& config, const std::string& path, ScenarioSpec& spec) {
  const std::string where =
      at_line(config, config.scenario_line > 0 ? config.scenario_line : config.game_line);
  const Expected<wad::WadFile> wad = wad::WadFile::open(path);
  if (!wad) return Error{wad.error().code, where + wad.error().message};
  const std::vector<std::string> maps = wad->map_names();
  if (maps.empty()) return Error{ErrorCode::kBadFormat, where + path + ": there is no map in it"};
  spec.map = config.map;
  const bool is_there = std::ranges::count(maps, spec.map) > 0;
  if (config.map_line > 0 && !is_there)
    return Error{ErrorCode::kNotFound, at_line(config, config.map_line) + "doom_map = " + config.map + ": " +
                                           path + " has " + joined(maps) + "; name one of these"};
  if (config.map_line == 0) {
    if (!is_there) spec.map = maps[0];
    if (maps.size() > 1 && !config.scenario_path.empty())
      spec.warnings.push_back(config.path + ": " + path + " has the maps " + joined(maps) + "; " + spec.map +
                              " is played; say which one with doom_map, or play all with --layout_pool " +
                              path);
  }
  const Expected<int> players = most_players(*wad, spec.map);
  if (!players) return Error{players.error().code, where + players.error().message};
  if (*players == 0)
    return Error{
        ErrorCode::kUnsupported,
        where + path + " " + spec.map + " has no start: put a thing 1 (player 1) or 11 (deathmatch) on it"};
  for (int agents = 1; agents <= *players; ++agents) spec.supported_agents.push_back(agents);
  if (config.host_count > *players)
    return Error{ErrorCode::kUnsupported,
                 fmt::format("{}: game_args: -host {}, but {} {} has starts for {}", config.path,
                             config.host_count, path, spec.map, *players)};
  return {};
}

}  // namespace

std::vector<RewardTerm> vizdoom_rewards(const VizdoomRewards& rewards, bool pays_while_dead) {
  std::vector<RewardTerm> terms;
  const auto add = [&](const char* name, const char* variable, const char* kind, double weight) {
    if (weight == 0.0) return;
    RewardTerm& term = terms.emplace_back();
    term.name = name, term.variable = variable, term.kind = kind, term.weight = weight;
  };
  add("map_reward", "MAP_REWARD", "delta", 1.0);
  add("living_reward", "MAP_TICS", "delta", rewards.living);
  const char* const death = pays_while_dead ? "DEAD" : "DEATHCOUNT";
  const char* const kind = pays_while_dead ? "value" : "event";
  add("death_penalty", death, kind, -rewards.death_penalty);
  add("death_reward", death, kind, rewards.death);
  add("map_exit_reward", "MAP_EXIT", "event", rewards.map_exit);
  add("kill_reward", "KILLCOUNT", "delta", rewards.kill);
  add("secret_reward", "SECRETCOUNT", "delta", rewards.secret);
  add("item_reward", "ITEMCOUNT", "delta", rewards.item);
  add("frag_reward", "FRAGCOUNT", "delta", rewards.frag);
  add("hit_reward", "HITCOUNT", "delta", rewards.hit);
  add("damage_made_reward", "DAMAGECOUNT", "delta", rewards.damage_made);
  add("hit_taken_reward", "HITS_TAKEN", "delta", rewards.hit_taken);
  add("damage_taken_reward", "DAMAGE_TAKEN", "delta", rewards.damage_taken);
  add("health_reward", "HEALTH", "rise", rewards.health);
  add("armor_reward", "ARMOR", "rise", rewards.armor);
  return terms;
}

Expected<ScenarioSpec> load_vizdoom_scenario(const std::string& path) {
  COMRAD_TRY_ASSIGN(const VizdoomConfig config, load_vizdoom_config(path));
  return vizdoom_scenario(config);
}

Expected<ScenarioSpec> vizdoom_scenario(const VizdoomConfig& config) {
  const std::string& path = config.path;
  ScenarioSpec spec;
  spec.is_vizdoom = true;
  spec.warnings = config.warnings;
  spec.warnings.insert(spec.warnings.end(), config.buffer_warnings.begin(), config.buffer_warnings.end());
  spec.name = spec.maps_of = fs::path(path).stem().string();
  spec.iwad = game_wad(config, spec);
  COMRAD_TRY_ASSIGN(const std::string wad, map_wad(config, spec.iwad));
  COMRAD_TRY(find_map(config, wad, spec));
  std::error_code ignored;
  const fs::path whole = fs::absolute(wad, ignored).lexically_normal();
  spec.folder = whole.parent_path().string(), spec.wad = whole.filename().string();
  spec.title = "ViZDoom's " + spec.name;
  spec.summary = path + ": " + spec.map + " of " + wad;
  spec.default_agents = std::max(config.host_count, 1);

  if (config.button_names.empty())
    return Error{ErrorCode::kBadFormat, path +
                                            ": there is nothing to press; list buttons, as in "
                                            "available_buttons = { MOVE_LEFT MOVE_RIGHT ATTACK }"};
  spec.heads = heads_of_buttons(config.button_names);
  for (const std::string& name : config.variable_names) {
    MeasurementTerm& term = spec.measurements.emplace_back();
    term.variable = name, term.scale = scale_of(find_variable(name).value()), term.clip = 10.0;
  }
  // The dead of a network game that play on are paid for in every decision, as in ViZDoom. Of several players, whose
  // programs there bring them back at once, each death is one event.
  spec.rewards = vizdoom_rewards(config.rewards,
                                 config.host_count == 1 || (config.host_count > 1 && config.forced_respawn));
  spec.score = "return";
  spec.maps_say_ceiling = false;

  spec.rules = config.rules;
  spec.rules.timeout_tics =
      config.timeout_tics > 0 ? std::min(config.timeout_tics, kLongestTimeoutTics) : kEngineLimitTics;
  spec.rules.lone_death_ends = true;
  spec.decision_limit = (spec.limit_tics() + kTicsPerDecision - 1) / kTicsPerDecision;
  spec.respawn = config.forced_respawn;
  spec.respawn_delay_tics = config.respawn_delay_tics;
  // What a file lists as available variables ViZDoom's agent is given; a health that no pixel shows decided whether
  // health_gathering was learned (scenarios/VIZDOOM_LEARNING.md).
  spec.training.origin = "ViZDoom's games";
  if (!spec.measurements.empty()) spec.training.values.emplace_back("small.all.use_additional_input", "true");
  spec.hud = config.hud, spec.crosshair = config.crosshair;
  spec.screen_flashes = config.screen_flashes, spec.weapon = config.weapon;
  if (config.minimal_hud)
    spec.warnings.push_back(path + ": render_minimal_hud is not served; render_hud shows the full bar");
  return spec;
}

}  // namespace comrad::scenarios
