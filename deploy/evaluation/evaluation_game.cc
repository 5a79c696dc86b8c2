#include "deploy/evaluation/evaluation_game.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "deploy/settings/content_hash.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/network_description.h"
#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/reward_weights.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

/// Settings that change what a network sees or how long its actions last, and no tensor.
constexpr const char* kFelt[] = {"scenario",    "scenario_version", "env_frameskip",
                                 "render_size", "renderer",         "resize"};

/// Which maps are played, where no flag names a map or a pool.
void choose_maps(const std::string& maps, RunConfig& config) {
  if (maps == word_of(EvalMaps::kTrain)) return;
  if (maps.empty() && names_vizdoom_config(config.run.scenario)) return;  // no recipe draws others
  if (maps.empty() && is_evaluated_on_one_map(config)) {
    config.environment.layout_pool.clear();
    return;
  }
  config.environment.layout_pool = kHeldOutPool;
  config.environment.wad.clear();
}

/// The settings with the scenario's own rewards where theirs come in stages, which help learning and are not what counts.
MergedSettings with_own_rewards(MergedSettings merged) {
  if (has_reward_schedule(merged.config.environment.reward)) merged.config.environment.reward.clear();
  return merged;
}

/// A run's settings with the user's settings on top, to be evaluated with.
Expected<MergedSettings> settings_onto(const RunConfig& trained, const EvaluationRequest& request,
                                       const UserSettings& user, const CommandLine& line, int core_count) {
  RunConfig run = trained;
  run.run.seed = RunConfig().run.seed;  // runs of different seeds meet the same evaluation episodes
  run.collection.deterministic = false;
  run.environment.scenario_version = 0;  // the present one is played, see prepare_network()
  for (const auto& [key, value] : user.typed.values)
    if (key == "variant") COMRAD_TRY(apply_layer(run, {user.typed.origin, {{key, value}}}));
  if (line.was_typed("layout_pool")) {
    run.environment.wad.clear();
  } else if (line.was_typed("wad") || line.was_typed("layout_seed")) {
    run.environment.layout_pool.clear();
  } else {
    choose_maps(request.maps, run);
  }
  if (run.environment.layout_pool.empty())
    run.curriculum = RunConfig().curriculum;  // no curriculum draws in an evaluation
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_onto_run(run, user, describe_scenario, core_count));
  forget_stale_layout(run, merged.config);
  return with_own_rewards(std::move(merged));
}

/// The game's settings: the first run's, or new ones without a run.
Expected<MergedSettings> settings_for(const std::vector<Player>& players, const EvaluationRequest& request,
                                      UserSettings user, const CommandLine& line, int core_count) {
  const auto first = std::ranges::find_if(players, &Player::is_network);
  if (first != players.end()) return settings_onto(first->trained, request, user, line, core_count);
  if (request.maps == word_of(EvalMaps::kHeldOut))
    user.typed.values.emplace_back("layout_pool", kHeldOutPool);
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_new(user, describe_scenario, core_count));
  return with_own_rewards(std::move(merged));
}

/// The same, with as many environments as there is something to do for, and one where it is recorded.
Expected<MergedSettings> sized_settings(const std::vector<Player>& players, const EvaluationRequest& request,
                                        UserSettings user, const CommandLine& line, bool is_recorded) {
  const int core_count = usable_cores();
  const auto set = [&](const char* name, int64_t value) {
    user.typed.values.emplace_back(name, std::to_string(value));
  };
  if (is_recorded)
    for (const char* name : {"num_workers", "num_envs_per_worker", "worker_num_splits"}) set(name, 1);
  COMRAD_TRY_ASSIGN(MergedSettings merged, settings_for(players, request, user, line, core_count));
  if (is_recorded || line.was_typed("num_envs_per_worker")) return merged;
  const CollectionSettings& collection = merged.config.collection;
  const int64_t enough =
      (static_cast<int64_t>(request.episodes) + collection.num_workers - 1) / collection.num_workers;
  if (enough >= collection.num_envs_per_worker) return merged;
  set("num_envs_per_worker", enough);
  return settings_for(players, request, user, line, core_count);
}

/// The list of a pool that a run has drawn already; empty where it has to be drawn or checked anew, for the run never
/// did, or its maps are no longer where they were.
std::string known_pool(const std::vector<Player>& players, const CommandLine& line, const RunConfig& config) {
  const auto first = std::ranges::find_if(players, &Player::is_network);
  if (first == players.end() || line.was_typed("layout_pool") || config.environment.layout_pool.empty())
    return "";
  const std::string path =
      first->run_dir + "/" +
      (config.environment.layout_pool == kHeldOutPool ? kHeldOutListFile : kLayoutListFile);
  const std::string text = read_file(path).value_or("");
  const Expected<LayoutList> list = parse_layout_list(text, path);
  if (!list) return "";
  for (const LayoutEntry& layout : list->layouts)
    if (!check_wad(layout.path)) return "";
  return text;
}

/// Everything that a network needs before it can play, found and checked.
Status prepare_network(Player& player, const EvaluationRequest& request, const UserSettings& user,
                       const CommandLine& line, const MergedSettings& game) {
  const auto of_player = [&player](const Error& error) {
    return Error{error.code, "run " + player.name + ": " + error.message};
  };
  Expected<MergedSettings> merged = settings_onto(player.trained, request, user, line, usable_cores());
  if (!merged) return of_player(merged.error());
  player.config = std::move(merged->config);
  player.env = merged->scenario.env;
  COMRAD_TRY(check_plays(player, game));
  for (const char* setting : kFelt)
    if (const std::string trained = setting_text(player.trained, setting),
        played = setting_text(game.config, setting);
        trained != played)
      std::fprintf(stderr, "comrad eval: note: run %s was trained with %s %s and plays with %s\n",
                   player.name.c_str(), setting, trained.c_str(), played.c_str());
  const bool is_named = request.policies.size() == 1 && request.policies.front() == player.name;
  COMRAD_TRY(
      choose_checkpoint(player, is_named ? request.checkpoint : "", player.config.run.load_checkpoint_kind));
  EnvShape env = game.scenario.env;
  env.global_state_count = player.env.global_state_count;  // its critic's, whatever the others' critics see
  const Expected<NetworkSize> size = describe_network(settings_to_play(player, game.config), env);
  if (!size) return of_player(size.error());
  player.network = *size;
  return {};
}

/// The scores of random play and of the scripted team, where they were measured on this very game.
Expected<std::optional<ReferenceScores>> references_of(const RunConfig& config) {
  const EnvironmentSettings& environment = config.environment;
  const RunConfig built_in;
  const bool is_default = environment.layout_pool.empty() &&
                          (environment.wad.empty() || is_generated_layout(config)) &&
                          environment.layout_seed == kReferenceLayoutSeed && environment.heads.empty() &&
                          environment.env_frameskip == built_in.environment.env_frameskip;
  if (!is_default) return std::optional<ReferenceScores>();
  return read_reference_scores(config.run.scenario, environment.num_agents);
}

}  // namespace

const Player& EvaluationGame::player(const std::string& name) const {
  return *std::ranges::find(players, name, &Player::name);
}

const std::string& EvaluationGame::map_name(uint64_t episode) const {
  return pool.layouts.empty() ? layout : pool.layouts[map_of(episode)].id;
}

Status check_maps(const std::string& maps, const CommandLine& line) {
  if (maps.empty()) return {};
  const std::vector<std::string> known(Words<EvalMaps>::words.begin(), Words<EvalMaps>::words.end());
  if (std::ranges::find(known, maps) == known.end())
    return Error{ErrorCode::kBadInput, "--maps: " + unknown_word("maps", maps, known)};
  for (const char* other : {"layout_pool", "wad", "layout_seed"})
    if (line.was_typed(other))
      return Error{ErrorCode::kBadInput,
                   "--maps and --" + std::string(other) + " both name maps; leave one of them out"};
  return {};
}

Expected<EvaluationGame> prepare_game(const EvaluationRequest& request, const CommandLine& line,
                                      bool is_recorded) {
  const UserSettings user{line.config_file(), line.typed()};
  RunConfig typed;
  COMRAD_TRY(apply_layer(typed, user.typed));
  if (has_reward_schedule(typed.environment.reward))
    return Error{
        ErrorCode::kBadInput,
        "--reward=" + typed.environment.reward +
            ": an evaluation makes no progress that weights could follow; give each term one number"};
  EvaluationGame game;
  for (const std::string& name : player_names(request)) {
    COMRAD_TRY_ASSIGN(Player player, find_player(name, typed.run.train_dir));
    if (player.is_person && request.page.empty())
      return Error{ErrorCode::kBadInput, "a person plays at a page; start comrad play SCENARIO"};
    game.players.push_back(std::move(player));
  }
  if (!request.checkpoint.empty() && !game.player(request.policies.front()).is_network())
    return Error{ErrorCode::kBadInput,
                 "--checkpoint is of a run; --policy " + request.policies.front() + " has none"};
  COMRAD_TRY_ASSIGN(game.merged, sized_settings(game.players, request, user, line, is_recorded));
  RunConfig& config = game.merged.config;
  COMRAD_TRY_ASSIGN(game.teams, make_teams(request, static_cast<int>(config.environment.num_agents)));
  for (Player& player : game.players)
    if (player.is_network()) COMRAD_TRY(prepare_network(player, request, user, line, game.merged));
  COMRAD_TRY_ASSIGN(game.references, references_of(config));

  game.episodes = static_cast<uint64_t>(request.episodes);
  print_warnings(game.merged.scenario);
  game.layout = layout_text(config);
  COMRAD_TRY_ASSIGN(TemporaryRun run, TemporaryRun::create(config, known_pool(game.players, line, config)));
  game.run = std::make_unique<TemporaryRun>(std::move(run));
  if (config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(const std::string hash, content_hash(config.environment.wad));
    game.map_hashes.push_back(hash);
    return game;
  }
  COMRAD_TRY_ASSIGN(game.pool, read_layout_list(game.run->path()));
  for (const LayoutEntry& layout : game.pool.layouts) {
    COMRAD_TRY_ASSIGN(const std::string hash, content_hash(layout.path));
    game.map_hashes.push_back(hash);
  }
  if (game.episodes < game.pool.layouts.size())
    std::fprintf(stderr, "comrad eval: %llu episodes reach the first %llu of %zu layouts alone\n",
                 static_cast<unsigned long long>(game.episodes),
                 static_cast<unsigned long long>(game.episodes), game.pool.layouts.size());
  return game;
}

}  // namespace comrad::deploy
