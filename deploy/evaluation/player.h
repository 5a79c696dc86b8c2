// A player for an agent's seat: a run's network, a seat of the scripted team, random play, or no action.
#pragma once

#include <optional>
#include <string>

#include "deploy/settings/merged_settings.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/network_size.h"
#include "rollout_buffer/settings/seat_plan.h"

namespace comrad::deploy {

/// A player that comrad play seats.
constexpr const char* kPerson = "person";

struct Player {
  std::string name;  ///< as typed
  SeatPlayer kind = SeatPlayer::kNoop;
  bool is_person = false;  ///< kNoop for the policy workers: the simulator presses what the person does
  // Of a network alone.
  std::string run_dir;
  RunConfig trained;  ///< as config.toml of its run states
  std::string checkpoint;
  std::string config_hash, checkpoint_hash;
  RunConfig config;     ///< `trained` with what the user typed on top
  EnvShape env;         ///< of the agents that it was trained for
  NetworkSize network;  ///< set by measure_network()

  bool is_network() const { return kind == SeatPlayer::kNetwork; }
};

/// "random", "oracle" or "noop": players that need no run; nothing for other names.
std::optional<SeatPlayer> player_without_run(const std::string& name);

/// Reads a player: "random", "oracle", "noop", "person", a run (its folder, or an experiment below `train_dir`), or a checkpoint
/// in a run's folder (a path that ends in .pt). Its settings and its checkpoint, unless one was named, are still to be
/// found. Errors: those of find_run() and load_run_config(); kNotFound for a checkpoint that is not there.
Expected<Player> find_player(const std::string& name, const std::string& train_dir);

/// `checkpoint` becomes the file that is played; empty: the newest or best one of the run. Its hash is taken.
/// Errors: kNotFound.
Status choose_checkpoint(Player& player, const std::string& checkpoint, CheckpointKind kind);

/// Whether this network can play the game of `merged`. Errors: kBadInput naming the player, what differs, and both values.
Status check_plays(const Player& player, const MergedSettings& game);

/// The settings that its worker programs read when it plays the game of `game`: its own network and algorithm, the
/// game's environment and collection.
RunConfig settings_to_play(const Player& player, const RunConfig& game);

}  // namespace comrad::deploy
