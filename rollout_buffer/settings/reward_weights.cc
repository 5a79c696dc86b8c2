#include "rollout_buffer/settings/reward_weights.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad {

Expected<std::vector<RewardWeight>> parse_reward_weights(const std::string& text) {
  constexpr std::size_t kMostWeights = 64;
  constexpr double kWeightMax = 1e6;
  const Error refused{ErrorCode::kBadInput, "'" + text + "' must be " + std::string(kRewardWeightsWords)};
  // What stands behind a comma and names nothing is one more point of the weight before it.
  std::vector<std::pair<std::string, std::string>> named;
  std::string_view rest = trimmed(text);
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(','), rest.size());
    const std::string_view one = trimmed(rest.substr(0, end));
    const std::size_t equals = one.find('=');
    if (equals != std::string_view::npos)
      named.emplace_back(trimmed(one.substr(0, equals)), one.substr(equals + 1));
    else if (!named.empty())
      named.back().second += "," + std::string(one);
    else
      return refused;
    rest = trimmed(rest.substr(std::min(end + 1, rest.size())));
  }
  if (named.size() > kMostWeights) return refused;
  std::vector<RewardWeight> weights;
  for (const auto& [name, value] : named) {
    const Expected<Schedule> weight = Schedule::parse(value);
    const auto is_small = [](double of_point) { return std::abs(of_point) <= kWeightMax; };
    if (name.empty() || !weight || !std::ranges::all_of(weight->points(), is_small, &Schedule::Point::value))
      return refused;
    weights.push_back({name, *weight});
  }
  return weights;
}

bool has_reward_schedule(const std::string& text) {
  const Expected<std::vector<RewardWeight>> weights = parse_reward_weights(text);
  return weights &&
         std::ranges::any_of(*weights, [](const RewardWeight& one) { return !one.weight.is_constant(); });
}

}  // namespace comrad
