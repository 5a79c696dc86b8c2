#include "deploy/evaluation/play.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

Status write_settings(const std::string& path, const RunConfig& config) {
  return write_file_atomically(path, settings_to_toml(config), /*durable=*/false);
}

/// The seats of a team of several players, and room for all their networks.
Status seat_players(const EvaluationGame& game, const Team& team, LaunchPlan& plan) {
  std::map<std::string, int> numbers;  // of networks, by player
  for (const std::string& name : team.players) {
    const Player& player = game.player(name);
    if (player.is_person) plan.page.people.push_back(static_cast<int>(plan.seats.seats.size()));
    Seat seat{player.kind, -1};
    if (player.is_network()) {
      const auto [found, is_new] = numbers.emplace(name, static_cast<int>(numbers.size()));
      seat.network = found->second;
      if (is_new) {
        const std::string settings = fmt::format("{}/network_{}.toml", plan.run_dir, seat.network);
        COMRAD_TRY(write_settings(settings, settings_to_play(player, game.merged.config)));
        plan.seats.networks.push_back({settings, player.checkpoint});
        // Each one's epsilon, a float, goes before its weights.
        plan.network.weights_bytes += static_cast<int64_t>(sizeof(float)) + player.network.weights_bytes;
        plan.network.recurrent_state_count =
            std::max(plan.network.recurrent_state_count, player.network.recurrent_state_count);
      }
    }
    plan.seats.seats.push_back(seat);
  }
  return write_file_atomically(plan.run_dir + "/" + kSeatPlanFile, seat_plan_text(plan.seats),
                               /*durable=*/false);
}

}  // namespace

Expected<LaunchPlan> plan_of(const EvaluationGame& game, const Team& team, bool greedy) {
  const Player& first = game.player(team.players.front());
  LaunchPlan plan;
  plan.config = game.merged.config;
  plan.env = game.merged.scenario.env;
  for (const std::string& name : team.players)
    if (game.player(name).is_network())
      plan.env.global_state_count =
          std::max(plan.env.global_state_count, game.player(name).env.global_state_count);
  plan.decision_limit = game.merged.scenario.decision_limit;
  plan.run_dir = game.run->path();
  plan.episodes = game.episodes;
  plan.greedy = greedy;
  if (!team.is_uniform() || first.kind == SeatPlayer::kNoop) {
    plan.policy = PolicySource::kSeats;
    COMRAD_TRY(seat_players(game, team, plan));
  } else if (first.is_network()) {
    plan.policy = PolicySource::kCheckpoint;
    plan.config = settings_to_play(first, plan.config);
    plan.network = first.network;
    plan.checkpoint = first.checkpoint;
  } else {
    plan.policy = first.kind == SeatPlayer::kOracle ? PolicySource::kOracle : PolicySource::kRandom;
  }
  COMRAD_TRY(write_settings(plan.run_dir + "/config.toml", plan.config));
  return plan;
}

Expected<RunOutcome> play(const LaunchPlan& plan) {
  COMRAD_TRY_ASSIGN(RunOutcome outcome, deploy::run(plan));
  if (outcome.reason != StopReason::kFinished || outcome.episodes.size() != plan.episodes)
    return Error{ErrorCode::kPeerLost,
                 fmt::format("only {} of {} episodes were played{}", outcome.episodes.size(), plan.episodes,
                             (outcome.message.empty() ? "" : ": " + outcome.message))};
  return outcome;
}

}  // namespace comrad::deploy
