#include "deploy/evaluation/player.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <span>

#include "deploy/settings/content_hash.h"
#include "deploy/settings/existing_run.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"
#include "rollout_buffer/settings/trained_game.h"

namespace comrad::deploy {

namespace fs = std::filesystem;

namespace {

std::string heads_text(const EnvShape& env) {
  return joined(std::span(env.head_sizes).first(static_cast<std::size_t>(env.head_count)), "x");
}

/// What of the agents' tensors differs, as game_difference() describes it; empty where nothing does.
std::string shape_difference(const EnvShape& trained, const EnvShape& played) {
  const auto differ = [](const std::string& what, auto there, auto here) {
    return fmt::format("{} is {} there and {} here", what, there, here);
  };
  if (trained.num_agents != played.num_agents)
    return differ("num_agents", trained.num_agents, played.num_agents);
  if (trained.channels != played.channels)
    return differ("the number of colours of a frame", trained.channels, played.channels);
  if (trained.width != played.width) return differ("the width of a frame", trained.width, played.width);
  if (trained.height != played.height) return differ("the height of a frame", trained.height, played.height);
  if (trained.measurement_count != played.measurement_count)
    return differ("the number of measurements", trained.measurement_count, played.measurement_count);
  if (heads_text(trained) != heads_text(played))
    return "the action heads have " + heads_text(trained) + " choices there and " + heads_text(played) +
           " here";
  return "";
}

}  // namespace

std::optional<SeatPlayer> player_without_run(const std::string& name) {
  for (const SeatPlayer kind : {SeatPlayer::kOracle, SeatPlayer::kRandom, SeatPlayer::kNoop})
    if (name == word_of(kind)) return kind;
  return std::nullopt;
}

Expected<Player> find_player(const std::string& name, const std::string& train_dir) {
  Player player;
  player.name = name;
  if (const std::optional<SeatPlayer> kind = player_without_run(name)) {
    player.kind = *kind;
    return player;
  }
  if (name == kPerson) {
    player.is_person = true;
    return player;
  }
  player.kind = SeatPlayer::kNetwork;
  std::string run = name;
  if (name.ends_with(".pt")) {
    std::error_code error;
    if (!fs::is_regular_file(name, error)) return Error{ErrorCode::kNotFound, "no checkpoint '" + name + "'"};
    player.checkpoint = fs::absolute(name, error).lexically_normal().string();
    run = fs::path(player.checkpoint).parent_path().parent_path().string();
  }
  COMRAD_TRY_ASSIGN(player.run_dir, find_run(run, train_dir));
  COMRAD_TRY_ASSIGN(player.trained, load_run_config(player.run_dir + "/config.toml"));
  COMRAD_TRY_ASSIGN(player.config_hash, content_hash(player.run_dir + "/config.toml"));
  return player;
}

Status choose_checkpoint(Player& player, const std::string& checkpoint, CheckpointKind kind) {
  std::error_code error;
  if (!checkpoint.empty()) {
    if (!fs::is_regular_file(checkpoint, error))
      return Error{ErrorCode::kNotFound, "--checkpoint=" + checkpoint +
                                             ": no such file; those of the run lie in " + player.run_dir +
                                             "/checkpoint"};
    player.checkpoint = fs::absolute(checkpoint, error).string();
  } else if (player.checkpoint.empty()) {
    COMRAD_TRY_ASSIGN(player.checkpoint, find_checkpoint(player.run_dir, kind));
  }
  COMRAD_TRY_ASSIGN(player.checkpoint_hash, content_hash(player.checkpoint));
  return {};
}

Status check_plays(const Player& player, const MergedSettings& game) {
  std::string difference = game_difference(player.config, game.config);
  if (difference.empty()) difference = shape_difference(player.env, game.scenario.env);
  if (difference.empty()) return {};
  return Error{ErrorCode::kBadInput, "run " + player.name +
                                         " was trained for another game than is played: " + difference +
                                         " (the first run that is named, or --scenario and the other flags "
                                         "where none is, say what is played)"};
}

RunConfig settings_to_play(const Player& player, const RunConfig& game) {
  RunConfig config = player.config;
  config.environment = game.environment;
  config.curriculum = game.curriculum;
  config.collection = game.collection;
  config.collection.precision = player.config.collection.precision;
  config.run.seed = game.run.seed;
  config.run.train_dir = game.run.train_dir;
  config.run.experiment = game.run.experiment;
  config.run.progress_interval = game.run.progress_interval;
  return config;
}

}  // namespace comrad::deploy
