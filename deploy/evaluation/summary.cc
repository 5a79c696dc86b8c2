#include "deploy/evaluation/summary.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "deploy/evaluation/statistics.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using Json = nlohmann::ordered_json;

double share_of(const EpisodeRecord& episode) { return double{episode.score} / double{episode.ceiling}; }

std::vector<double> numbers(std::span<const float> values) { return {values.begin(), values.end()}; }

Json normalised(const ScoreScale& scale, double score) {
  return scale.references ? Json(scale.references->normalised(score)) : Json();
}

std::vector<double> scores_of(const PlayedTeam& played) {
  std::vector<double> scores;
  for (const EpisodeRecord& episode : played.episodes) scores.push_back(episode.score);
  return scores;
}

/// `text(player)` of a team: of the one player, or of every seat, separated by blanks; null where all are empty.
template <typename Text>
Json of_seats(const EvaluationGame& game, const Team& team, Text&& text) {
  if (team.is_uniform()) {
    const std::string one = text(game.player(team.players.front()));
    return one.empty() ? Json() : Json(one);
  }
  std::vector<std::string> all;
  bool has_any = false;
  for (const std::string& name : team.players) {
    const std::string one = text(game.player(name));
    has_any |= !one.empty();
    all.push_back(one.empty() ? "-" : one);
  }
  return has_any ? Json(joined(all, " ")) : Json();
}

std::string config_hash_of(const Player& player) { return player.config_hash; }
std::string checkpoint_hash_of(const Player& player) { return player.checkpoint_hash; }

std::string checkpoint_text(const EvaluationGame& game, const Team& team) {
  const Json text = of_seats(game, team, [](const Player& player) { return player.checkpoint; });
  return text.is_null() ? "" : text.get<std::string>();
}

void add_layouts(const EvaluationGame& game, const PlayedTeam& played, Json& summary) {
  if (game.pool.layouts.empty()) return;
  std::vector<std::vector<double>> by_layout(game.pool.layouts.size());
  for (const EpisodeRecord& episode : played.episodes)
    by_layout[game.map_of(episode.episode_id)].push_back(episode.score);
  std::vector<double> means;
  Json layouts = Json::object(), allowed = layouts;
  for (std::size_t i = 0; i < by_layout.size(); ++i) {
    if (by_layout[i].empty()) continue;
    const LayoutEntry& layout = game.pool.layouts[i];
    means.push_back(mean(by_layout[i]));
    layouts[layout.id] = means.back();
    if (layout.ceiling > 0) allowed[layout.id] = layout.ceiling;
  }
  summary["layouts"] = means.size();
  summary["J_ci95_layouts"] = confidence_95(means);
  summary["J_by_layout"] = layouts;
  summary["ceiling_by_layout"] = allowed;
}

}  // namespace

ScoreScale scale_of(const EvaluationGame& game, const std::vector<PlayedTeam>& played) {
  std::optional<double> random, scripted;
  for (const PlayedTeam& one : played) {
    if (!one.team->is_uniform()) continue;
    const SeatPlayer kind = game.player(one.team->players.front()).kind;
    if (kind == SeatPlayer::kRandom) random = mean(scores_of(one));
    if (kind == SeatPlayer::kOracle) scripted = mean(scores_of(one));
  }
  if (random && scripted && *scripted > *random)
    return {ReferenceScores{.random = *random, .scripted = *scripted},
            "random and oracle of this evaluation"};
  if (game.references) return {game.references, "scenarios/reference_scores.toml"};
  return {};
}

Json summarise(const EvaluationGame& game, const PlayedTeam& played, const ScoreScale& scale, bool greedy,
               bool each) {
  const RunConfig& config = game.merged.config;
  const auto agents = static_cast<std::size_t>(config.environment.num_agents);
  std::vector<double> returns, lengths, ceilings, shares;
  std::vector<double> agent_scores(agents, 0.0);
  const std::vector<double> scores = scores_of(played);
  for (const EpisodeRecord& episode : played.episodes) {
    returns.push_back(mean(numbers(episode.returns())));
    lengths.push_back(episode.length_tics);
    for (std::size_t agent = 0; agent < agents; ++agent)
      agent_scores[agent] += agent < episode.scores().size() ? double{episode.scores()[agent]} : std::nan("");
    if (!(episode.ceiling > 0)) continue;
    ceilings.push_back(episode.ceiling);
    shares.push_back(share_of(episode));
  }
  for (double& score : agent_scores) score /= static_cast<double>(played.episodes.size());
  const Team& team = *played.team;
  Json summary = {{"scenario", config.run.scenario},
                  {"scenario_version", config.environment.scenario_version},
                  {"policy", team.name},
                  {"episodes", played.episodes.size()},
                  {"seed", config.run.seed},
                  {"num_agents", config.environment.num_agents},
                  {"layout", game.layout},
                  {"J_mean", mean(scores)},
                  {"J_ci95", confidence_95(scores)},
                  {"J_per_agent", agent_scores},
                  {"return_mean", mean(returns)},
                  {"length_tics_mean", mean(lengths)},
                  {"ceiling", ceilings.empty() ? 0.0 : mean(ceilings)},
                  {"J_share", shares.empty() ? Json() : Json(mean(shares))},
                  {"J_normalised", normalised(scale, mean(scores))},
                  {"greedy", greedy},
                  {"checkpoint", checkpoint_text(game, team)},
                  {"config_hash", of_seats(game, team, config_hash_of)},
                  {"checkpoint_hash", of_seats(game, team, checkpoint_hash_of)}};
  if (scale.references)
    summary["references"] = {{"random", scale.references->random},
                             {"scripted", scale.references->scripted},
                             {"from", scale.source}};
  if (!team.is_uniform()) summary["seats"] = team.players;
  Json maps = Json::object();
  for (const EpisodeRecord& episode : played.episodes)
    maps[game.map_name(episode.episode_id)] = game.map_hashes[game.map_of(episode.episode_id)];
  summary["map_hashes"] = maps;
  // Simulators play the layouts of a pool in turn, by the number of the episode.
  if (each)
    for (const EpisodeRecord& episode : played.episodes)
      summary["each"].push_back({{"episode", episode.episode_id},
                                 {"layout", game.map_name(episode.episode_id)},
                                 {"J", episode.score},
                                 {"J_per_agent", numbers(episode.scores())},
                                 {"ceiling", episode.ceiling},
                                 {"length_tics", episode.length_tics},
                                 {"terminated", episode.terminated != 0},
                                 {"return", mean(numbers(episode.returns()))}});
  add_layouts(game, played, summary);
  return summary;
}

std::vector<Json> episode_rows(const EvaluationGame& game, const PlayedTeam& played,
                               const ScoreScale& scale) {
  std::vector<Json> rows;
  const Team& team = *played.team;
  for (const EpisodeRecord& episode : played.episodes)
    rows.push_back({{"policy", team.name},
                    {"scenario", game.merged.config.run.scenario},
                    {"episode", episode.episode_id},
                    {"seed", episode.episode_seed},
                    {"layout", game.map_name(episode.episode_id)},
                    {"map_hash", game.map_hashes[game.map_of(episode.episode_id)]},
                    {"J", episode.score},
                    {"J_per_agent", numbers(episode.scores())},
                    {"ceiling", episode.ceiling > 0 ? Json(episode.ceiling) : Json()},
                    {"J_share", episode.ceiling > 0 ? Json(share_of(episode)) : Json()},
                    {"J_normalised", normalised(scale, episode.score)},
                    {"return", mean(numbers(episode.returns()))},
                    {"length_tics", episode.length_tics},
                    {"terminated", episode.terminated != 0},
                    {"config_hash", of_seats(game, team, config_hash_of)},
                    {"checkpoint_hash", of_seats(game, team, checkpoint_hash_of)},
                    {"scenario_version", game.merged.config.environment.scenario_version}});
  return rows;
}

Json summary_row(const Json& summary) {
  Json row;
  for (const char* key :
       {"policy", "scenario", "num_agents", "layout", "episodes", "seed", "greedy", "J_mean", "J_ci95",
        "J_per_agent", "J_share", "J_normalised", "ceiling", "return_mean", "length_tics_mean", "checkpoint",
        "config_hash", "checkpoint_hash", "scenario_version"})
    row[key] = summary[key];
  return row;
}

}  // namespace comrad::deploy
