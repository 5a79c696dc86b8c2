#include "learner/reports/metrics.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace comrad::learn {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace

void RateWindow::add(double time_s, uint64_t env_frames, uint64_t decisions) {
  samples_.push_back({time_s, env_frames, decisions});
  while (samples_.size() > 2 && samples_[1].time_s <= time_s - window_s_) samples_.pop_front();
}

double RateWindow::rate(uint64_t Sample::*counter) const {
  if (samples_.size() < 2) return 0;
  const Sample &first = samples_.front(), &last = samples_.back();
  const double seconds = last.time_s - first.time_s;
  return seconds > 0 ? static_cast<double>(last.*counter - first.*counter) / seconds : 0;
}

void EpisodeWindow::add(const EpisodeRecord& episode, int num_agents) {
  const std::span returns = std::span(episode.agent_return).first(static_cast<std::size_t>(num_agents));
  const auto [low, high] = std::minmax_element(returns.begin(), returns.end());
  push({.score = episode.score,
        .return_mean = std::accumulate(returns.begin(), returns.end(), 0.0) / num_agents,
        .return_min = *low,
        .return_max = *high,
        .length_tics = static_cast<double>(episode.length_tics),
        .score_share = episode.ceiling > 0 ? episode.score / episode.ceiling : kNaN});
  ++episodes_;
}

void EpisodeWindow::push(const Episode& episode) {
  window_.push_back(episode);
  if (window_.size() > static_cast<std::size_t>(capacity_)) window_.pop_front();
}

std::vector<double> EpisodeWindow::state() const {
  std::vector<double> numbers;
  numbers.reserve(window_.size() * kFields);
  for (const Episode& episode : window_)
    for (const double number : {episode.score, episode.return_mean, episode.return_min, episode.return_max,
                                episode.length_tics, episode.score_share})
      numbers.push_back(number);
  return numbers;
}

Status EpisodeWindow::restore(std::span<const double> state, std::size_t fields) {
  if (fields + 1 < kFields || fields > kFields || state.size() % fields != 0)
    return Error{ErrorCode::kBadFormat,
                 fmt::format("a window of episodes has {} numbers by {}, {} make an episode", state.size(),
                             fields, kFields)};
  window_.clear();
  for (; !state.empty(); state = state.subspan(fields))
    push({.score = state[0],
          .return_mean = state[1],
          .return_min = state[2],
          .return_max = state[3],
          .length_tics = state[4],
          .score_share = fields < kFields ? kNaN : state[5]});
  return {};
}

double EpisodeWindow::score_mean() const {
  double sum = 0;
  for (const Episode& episode : window_) sum += episode.score;
  return window_.empty() ? kNaN : sum / static_cast<double>(window_.size());
}

double EpisodeWindow::return_mean() const {
  double sum = 0;
  for (const Episode& episode : window_) sum += episode.return_mean;
  return window_.empty() ? kNaN : sum / static_cast<double>(window_.size());
}

void EpisodeWindow::append_to(MetricValues& values) const {
  if (window_.empty()) return;
  const auto least = [this](double Episode::*member) {
    return (*std::ranges::min_element(window_, {}, member)).*member;
  };
  const auto most = [this](double Episode::*member) {
    return (*std::ranges::max_element(window_, {}, member)).*member;
  };
  double length = 0, paid = 0;
  for (const Episode& episode : window_) {
    length += episode.length_tics;
    paid += episode.return_min != 0 || episode.return_max != 0;
  }
  values.emplace_back("reward/reward", return_mean());
  values.emplace_back("reward/reward_min", least(&Episode::return_min));
  values.emplace_back("reward/reward_max", most(&Episode::return_max));
  values.emplace_back("len/len", length / static_cast<double>(window_.size()));
  values.emplace_back("len/len_min", least(&Episode::length_tics));
  values.emplace_back("len/len_max", most(&Episode::length_tics));
  values.emplace_back("policy_stats/avg_true_objective", score_mean());
  values.emplace_back("policy_stats/avg_true_objective_min", least(&Episode::score));
  values.emplace_back("policy_stats/avg_true_objective_max", most(&Episode::score));
  double share = 0;
  int64_t shares = 0;
  for (const Episode& episode : window_)
    if (std::isfinite(episode.score_share)) share += episode.score_share, ++shares;
  if (shares > 0)
    values.emplace_back("policy_stats/avg_true_objective_share", share / static_cast<double>(shares));
  values.emplace_back("stats/rewarded_episodes_fraction", paid / static_cast<double>(window_.size()));
}

}  // namespace comrad::learn
