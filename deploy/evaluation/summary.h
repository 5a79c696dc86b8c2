// What the episodes of a team say: one object of numbers, and one row an episode.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "deploy/evaluation/evaluation_game.h"
#include "rollout_buffer/schema/episode_record.h"

namespace comrad::deploy {

/// The episodes of one team, ordered by episode_id.
struct PlayedTeam {
  const Team* team;
  std::vector<EpisodeRecord> episodes;
};

/// What J is compared with.
struct ScoreScale {
  std::optional<ReferenceScores> references;
  std::string source;  ///< in words
};

/// Random play and the scripted team of this very evaluation where it holds both, else the game's references.
ScoreScale scale_of(const EvaluationGame& game, const std::vector<PlayedTeam>& played);

/// Means of a team with the 95 % interval of J over episodes (Student t), hashes of what was played, and its layouts;
/// with `each`, every episode, too. The keys are those of `comrad eval --json`.
nlohmann::ordered_json summarise(const EvaluationGame& game, const PlayedTeam& played,
                                 const ScoreScale& scale, bool greedy, bool each);

/// A row an episode: policy, scenario, episode, seed, layout, map_hash, J, J_per_agent, ceiling, J_share, J_normalised,
/// return, length_tics, terminated, and the hashes of settings and checkpoints.
std::vector<nlohmann::ordered_json> episode_rows(const EvaluationGame& game, const PlayedTeam& played,
                                                 const ScoreScale& scale);

/// Of a summary what fits into a row of a table.
nlohmann::ordered_json summary_row(const nlohmann::ordered_json& summary);

}  // namespace comrad::deploy
