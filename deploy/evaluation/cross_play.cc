#include "deploy/evaluation/cross_play.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "deploy/evaluation/statistics.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/score_text.h"

namespace comrad::deploy {
namespace {

using Json = nlohmann::ordered_json;

CrossMean mean_of(const std::vector<double>& values) { return {mean(values), confidence_95(values)}; }

Json as_json(const CrossMean& value) { return {{"J_mean", value.mean}, {"J_ci95", value.ci95}}; }

std::string text_of(const CrossMean& value) {
  char text[64];
  std::snprintf(text, sizeof text, "%s +- %.2g", score_text(value.mean).c_str(), value.ci95);
  return text;
}

}  // namespace

CrossPlay cross_play_of(std::vector<std::string> players, const std::vector<std::vector<double>>& scores) {
  const std::size_t count = players.size(), episodes = scores.front().size();
  COMRAD_CHECK(scores.size() == count * count, "every player meets every player");
  CrossPlay result;
  result.players = std::move(players);
  result.J.resize(count);
  std::vector<double> self(episodes, 0.0), cross(episodes, 0.0), gap(episodes, 0.0);
  for (std::size_t row = 0; row < count; ++row)
    for (std::size_t column = 0; column < count; ++column) {
      const std::vector<double>& cell = scores[row * count + column];
      result.J[row].push_back(mean_of(cell));
      for (std::size_t episode = 0; episode < episodes; ++episode)
        (row == column ? self : cross)[episode] += cell[episode];
    }
  for (std::size_t episode = 0; episode < episodes; ++episode) {
    self[episode] /= static_cast<double>(count);
    cross[episode] /= static_cast<double>(count * (count - 1));
    gap[episode] = self[episode] - cross[episode];
  }
  result.self = mean_of(self);
  result.cross = mean_of(cross);
  result.gap = mean_of(gap);
  return result;
}

Json cross_play_json(const CrossPlay& result) {
  Json means = Json::array(), half_widths = Json::array();
  for (const std::vector<CrossMean>& row : result.J) {
    Json of_means = Json::array(), of_half_widths = Json::array();
    for (const CrossMean& cell : row) {
      of_means.push_back(cell.mean);
      of_half_widths.push_back(cell.ci95);
    }
    means.push_back(of_means);
    half_widths.push_back(of_half_widths);
  }
  return {{"players", result.players},
          {"J", means},
          {"J_ci95", half_widths},
          {"self_play", as_json(result.self)},
          {"cross_play", as_json(result.cross)},
          {"gap", as_json(result.gap)}};
}

std::string cross_play_table(const CrossPlay& result) {
  const std::size_t count = result.players.size();
  std::vector<std::vector<std::string>> cells(count + 1);
  cells[0].push_back("seat 0 \\ others");
  for (const std::string& player : result.players) cells[0].push_back(player);
  for (std::size_t row = 0; row < count; ++row) {
    cells[row + 1].push_back(result.players[row]);
    for (const CrossMean& cell : result.J[row]) cells[row + 1].push_back(text_of(cell));
  }
  std::vector<std::size_t> widths(count + 1, 0);
  for (const std::vector<std::string>& row : cells)
    for (std::size_t column = 0; column < row.size(); ++column)
      widths[column] = std::max(widths[column], row[column].size());
  std::string table;
  for (const std::vector<std::string>& row : cells) {
    std::string line;
    for (std::size_t column = 0; column < row.size(); ++column) {
      line += row[column];
      if (column + 1 < row.size()) line.append(widths[column] - row[column].size() + 2, ' ');
    }
    table += line + "\n";
  }
  return table + "self-play " + text_of(result.self) + ", cross-play " + text_of(result.cross) + ", gap " +
         text_of(result.gap) + "\n";
}

}  // namespace comrad::deploy
