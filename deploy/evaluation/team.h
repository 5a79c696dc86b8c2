// Which player plays which agent: the teams that an evaluation plays one after the other.
#pragma once

#include <string>
#include <vector>

#include "deploy/evaluation/request.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

struct Team {
  std::string name;                  ///< the one player's, or "0=RUN_A,1=oracle"
  std::vector<std::string> players;  ///< [N], names by agent index
  bool is_uniform() const;           ///< one player has all seats
};

/// What can be said of a request before the team's size is known. Errors: kBadInput for a request without a player,
/// for a seat that cannot be read or is named twice, and for flags that do not go together.
Status check_teams(const EvaluationRequest& request);

/// The names of all players, each once, in the order in which they were typed.
std::vector<std::string> player_names(const EvaluationRequest& request);

/// The teams of `num_agents` agents of a checked request; for a cross-play row by row: the row's player has
/// seat 0, the column's all others. Errors: kBadInput for a seat beyond the team, and for one without a player.
Expected<std::vector<Team>> make_teams(const EvaluationRequest& request, int num_agents);

}  // namespace comrad::deploy
