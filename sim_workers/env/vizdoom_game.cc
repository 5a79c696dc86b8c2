#include "sim_workers/env/vizdoom_game.h"

#include <algorithm>
#include <filesystem>

#include "doomgen/wad/iwad_search.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/env/game_variables.h"
#include "sim_workers/env/play_options.h"

namespace comrad::sim {
Expected<std::shared_ptr<const VizdoomGame>> load_vizdoom_game(scenarios::VizdoomConfig config,
                                                               const std::string& wad_path) {
  auto game = std::make_shared<VizdoomGame>();
  if (!config.game_path.empty()) {
    game->iwad_path = scenarios::existing_file(config.game_path);
    std::error_code failure;
    if (!std::filesystem::exists(game->iwad_path, failure)) {
      config.warnings.push_back(config.path + ": doom_game_path " + config.game_path +
                                " is not there; the IWAD is looked for in the usual places");
      game->iwad_path.clear();
    }
  }
  std::string path = wad_path.empty() ? config.scenario_path : wad_path;
  if (path.empty()) {
    COMRAD_TRY_ASSIGN(path, wad::find_iwad(game->iwad_path));
  } else {
    path = scenarios::existing_file(path);
    game->art_paths.push_back(path);
  }
  COMRAD_TRY_ASSIGN(const wad::WadFile wad, wad::WadFile::open(path));
  COMRAD_TRY_ASSIGN(game->content, load_game_content(wad, config.map));
  game->content.warnings.insert(game->content.warnings.begin(), config.warnings.begin(),
                                config.warnings.end());
  game->config = std::move(config);
  return std::shared_ptr<const VizdoomGame>(std::move(game));
}

VizdoomEpisode::VizdoomEpisode(std::shared_ptr<const VizdoomGame> game)
    : game_(std::move(game)), world_(game_->content.level, game_->content.catalog, game_->content.behavior) {}

void VizdoomEpisode::reset(uint64_t seed) {
  const scenarios::VizdoomConfig& config = game_->config;
  doom::WorldOptions options = world_options(config.rules);
  options.seed = seed;
  options.crosshair = config.crosshair;
  options.forced_respawn = config.forced_respawn;
  options.respawn_delay_tics = config.respawn_delay_tics;
  reset_world(world_, options);
  run_start_tics(world_, config.rules);
  first_tic_ = world_.tic_count();
  before_ = counts();
  finished_ = world_.level_exited() || !world_.player(0).alive;
  total_reward_ = 0;
}

double VizdoomEpisode::step(const doom::Buttons& buttons, int tics) {
  const uint64_t tic_before = world_.tic_count();
  const uint64_t timeout = static_cast<uint64_t>(game_->config.timeout_tics);
  for (int i = 0; i < tics && !finished_; ++i) {
    run_tic(world_, {&buttons, 1});
    finished_ = world_.level_exited() || !world_.player(0).alive ||
                (timeout > 0 && world_.tic_count() >= first_tic_ + timeout);
  }
  const uint64_t tics_passed = world_.tic_count() - tic_before;
  if (tics_passed == 0) return 0;

  const scenarios::VizdoomRewards& pay = game_->config.rewards;
  const Counts now = counts();
  double reward = (int64_t{now.map_reward} - before_.map_reward) / 65536.0 +
                  pay.living * static_cast<double>(tics_passed);
  if (!world_.player(0).alive) reward += pay.death - pay.death_penalty;
  if (world_.level_exited()) reward += pay.map_exit;
  reward += pay.kill * (now.kills - before_.kills) + pay.secret * (now.secrets - before_.secrets) +
            pay.item * (now.items - before_.items) + pay.frag * (now.frags - before_.frags) +
            pay.hit * (now.hits - before_.hits) + pay.damage_made * (now.damage_made - before_.damage_made) +
            pay.hit_taken * (now.hits_taken - before_.hits_taken) +
            pay.damage_taken * (now.damage_taken - before_.damage_taken) +
            pay.health * std::max(0, now.health - before_.health) +
            pay.armor * std::max(0, now.armor - before_.armor);
  before_ = now;
  total_reward_ += reward;
  return reward;
}

double VizdoomEpisode::variable(const scenarios::GameVariable& variable) const {
  if (variable.kind == scenarios::VariableKind::kHealth) return world_.body(0).health;
  return read_variable(world_, 0, variable);
}

VizdoomEpisode::Counts VizdoomEpisode::counts() const {
  const doom::Player& player = world_.player(0);
  return {.map_reward = world_.state().globals[0],
          .kills = player.kill_count,
          .secrets = player.secret_count,
          .items = player.item_count,
          .frags = player.frag_count,
          .hits = player.hits_dealt,
          .damage_made = player.damage_dealt,
          .hits_taken = player.hits_taken,
          .damage_taken = player.damage_taken,
          .health = player.health,
          .armor = player.armor};
}

}  // namespace comrad::sim
