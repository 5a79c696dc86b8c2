// The game that all players of one evaluation meet in: its settings, its maps and what they hash to, and the scores that
// J is compared with. The first run that is named decides what is played, the user's flags on top.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "deploy/evaluation/player.h"
#include "deploy/evaluation/request.h"
#include "deploy/evaluation/team.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/settings/reference_scores.h"

namespace comrad::deploy {

struct EvaluationGame {
  MergedSettings merged;
  std::vector<Player> players;                  ///< each once
  std::vector<Team> teams;                      ///< to be played in this order
  uint64_t episodes = 0;                        ///< of each team
  std::string layout;                           ///< the maps in words
  LayoutList pool;                              ///< empty: one map
  std::vector<std::string> map_hashes;          ///< by place in the pool; one where there is none
  std::optional<ReferenceScores> references;    ///< of the default map and team, where they are played
  std::unique_ptr<TemporaryRun> run = nullptr;  ///< folder that is played in, removed with the game

  const Player& player(const std::string& name) const;
  /// Place in `map_hashes` of the map that an episode plays.
  std::size_t map_of(uint64_t episode) const { return episode % map_hashes.size(); }
  /// Its name: of a pool the layout's, else `layout`.
  const std::string& map_name(uint64_t episode) const;
};

/// Errors: kBadInput for a word that --maps does not take, or maps that are named twice.
Status check_maps(const std::string& maps, const CommandLine& line);

/// Checks all players and makes the maps; nothing is played yet. `is_recorded`: one environment plays everything.
/// Errors: those of find_player(), merge_new(), merge_onto_run(), check_plays(), make_teams(), describe_network() and
/// TemporaryRun::create(); kBadInput for a --checkpoint of a player that has none.
Expected<EvaluationGame> prepare_game(const EvaluationRequest& request, const CommandLine& line,
                                      bool is_recorded);

}  // namespace comrad::deploy
