#include "learner/reports/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace comrad::learn {
namespace metrics_test {

EpisodeRecord episode(float score, std::array<float, 2> agent_return, uint32_t length_tics) {
  EpisodeRecord record{};
  record.score = score;
  record.agent_count = 2;
  std::ranges::copy(agent_return, record.agent_return.begin());
  record.length_tics = length_tics;
  return record;
}

TEST(EpisodeWindow, AveragesTheLastEpisodesOnly) {
  EpisodeWindow window(2);
  EXPECT_TRUE(std::isnan(window.score_mean()));
  window.add(episode(100, {1, 1}, 40), 2);
  window.add(episode(10, {2, 4}, 80), 2);
  window.add(episode(20, {6, 10}, 120), 2);
  EXPECT_EQ(window.episodes(), 3u);
  EXPECT_DOUBLE_EQ(window.score_mean(), 15);
  EXPECT_DOUBLE_EQ(window.return_mean(), (3 + 8) / 2.0);
  MetricValues values;
  window.append_to(values);
  const auto find = [&](const std::string& name) {
    for (const auto& [key, value] : values)
      if (key == name) return value;
    return std::nan("");
  };
  EXPECT_DOUBLE_EQ(find("reward/reward"), 5.5);
  EXPECT_DOUBLE_EQ(find("reward/reward_min"), 2);
  EXPECT_DOUBLE_EQ(find("reward/reward_max"), 10);
  EXPECT_DOUBLE_EQ(find("len/len"), 100);
  EXPECT_DOUBLE_EQ(find("policy_stats/avg_true_objective"), 15);
  EXPECT_DOUBLE_EQ(find("policy_stats/avg_true_objective_max"), 20);
}

TEST(EpisodeWindow, CountsEpisodesInWhichAnyAgentsReturnIsNotZero) {
  EpisodeWindow window(4);
  window.add(episode(0, {0, 0}, 40), 2);
  window.add(episode(0, {0, -1}, 40), 2);
  window.add(episode(0, {2, -2}, 40), 2);
  window.add(episode(7, {0, 0}, 40), 2);
  MetricValues values;
  window.append_to(values);
  EXPECT_EQ(values.back().first, "stats/rewarded_episodes_fraction");
  EXPECT_DOUBLE_EQ(values.back().second, 0.5);
}

TEST(EpisodeWindow, ReportsScoresAsSharesOfWhatEachMapAllows) {
  const auto share_of = [](const EpisodeWindow& window) {
    MetricValues values;
    window.append_to(values);
    for (const auto& [key, value] : values)
      if (key == "policy_stats/avg_true_objective_share") return value;
    return -1.0;
  };
  EpisodeWindow window(4);
  window.add(episode(7, {0, 0}, 40), 2);
  EXPECT_EQ(share_of(window), -1) << "no map said its ceiling";
  for (const auto& [score, ceiling] : {std::pair{35.0f, 35.0f}, {23.5f, 47.0f}}) {
    EpisodeRecord record = episode(score, {0, 0}, 40);
    record.ceiling = ceiling;
    window.add(record, 2);
  }
  EXPECT_DOUBLE_EQ(share_of(window), 0.75);
  EpisodeWindow again(4);
  ASSERT_TRUE(again.restore(window.state()));
  EXPECT_DOUBLE_EQ(share_of(again), 0.75);
  // Checkpoints from before there were shares have a number less.
  const std::vector<double> older(2 * (EpisodeWindow::kFields - 1), 3.0);
  ASSERT_TRUE(again.restore(older, EpisodeWindow::kFields - 1));
  EXPECT_EQ(again.size(), 2u);
  EXPECT_DOUBLE_EQ(again.score_mean(), 3);
  EXPECT_EQ(share_of(again), -1);
  EXPECT_FALSE(again.restore(older, EpisodeWindow::kFields - 2));
}

TEST(EpisodeWindow, ContinuesInAnotherProcess) {
  EpisodeWindow window(3);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(window.is_full(), i == 3) << i;
    window.add(
        episode(static_cast<float>(i), {1.0f * static_cast<float>(i), 2.0f * static_cast<float>(i)}, 40), 2);
  }
  EpisodeWindow again(3);
  ASSERT_TRUE(again.restore(window.state()));
  EXPECT_TRUE(again.is_full());
  EXPECT_EQ(again.episodes(), 0u);
  MetricValues before, after;
  window.append_to(before);
  again.append_to(after);
  EXPECT_EQ(before, after);
  window.add(episode(10, {0, 0}, 4), 2);
  again.add(episode(10, {0, 0}, 4), 2);
  EXPECT_DOUBLE_EQ(again.score_mean(), window.score_mean());
}

TEST(EpisodeWindow, TakesTheNewestThatFitAndNoBrokenOnes) {
  EpisodeWindow window(10);
  for (int i = 0; i < 10; ++i) window.add(episode(static_cast<float>(i), {0, 0}, 40), 2);
  EpisodeWindow shorter(2), longer(20);
  ASSERT_TRUE(shorter.restore(window.state()));
  EXPECT_DOUBLE_EQ(shorter.score_mean(), 8.5);
  ASSERT_TRUE(longer.restore(window.state()));
  EXPECT_FALSE(longer.is_full());
  std::vector<double> broken = window.state();
  broken.pop_back();
  EXPECT_FALSE(longer.restore(broken));
  ASSERT_TRUE(longer.restore({}));
  EXPECT_EQ(longer.size(), 0u);
}

TEST(RateWindow, IsTheSlopeOverTheWindow) {
  RateWindow rates(10);
  EXPECT_EQ(rates.env_frames_per_s(), 0);
  rates.add(0, 0, 0);
  EXPECT_EQ(rates.env_frames_per_s(), 0);
  rates.add(5, 4000, 1000);
  EXPECT_DOUBLE_EQ(rates.env_frames_per_s(), 800);
  EXPECT_DOUBLE_EQ(rates.decisions_per_s(), 200);
  rates.add(10, 8000, 2000);
  rates.add(15, 8000, 2000);  // stalled; the sample at 5 s is the window's edge now
  EXPECT_DOUBLE_EQ(rates.env_frames_per_s(), 400);
}

}  // namespace metrics_test
}  // namespace comrad::learn
