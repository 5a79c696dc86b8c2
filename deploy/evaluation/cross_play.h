// Each player with each: the row's player has seat 0, the column's all others. With two agents that is the matrix of
// zero-shot coordination; with more, a newcomer in its own team.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/evaluation/summary.h"

namespace comrad::deploy {

/// A mean over cells and the half-width of its 95 % interval: over episodes (Student t), of which every cell plays the
/// same, so that luck of the episode falls out of a difference.
struct CrossMean {
  double mean = 0;
  double ci95 = 0;
};

struct CrossPlay {
  std::vector<std::string> players;       ///< K
  std::vector<std::vector<CrossMean>> J;  ///< [K rows][K columns]
  CrossMean self, cross, gap;             ///< the diagonal, all other cells, the first minus the second
};

/// `scores` [K * K cells, row by row][episodes].
CrossPlay cross_play_of(std::vector<std::string> players, const std::vector<std::vector<double>>& scores);

/// As `--json` has it, without the cells' own summaries.
nlohmann::ordered_json cross_play_json(const CrossPlay& result);

/// For people; ends with a newline.
std::string cross_play_table(const CrossPlay& result);

}  // namespace comrad::deploy
