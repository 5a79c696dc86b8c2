// What the learner's reports are made from: statistics over the last episodes, and rates over a sliding window.
// Stage: beside update, for eyes and scripts.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/metrics/metrics_file.h"
#include "rollout_buffer/schema/episode_record.h"

namespace comrad::learn {

/// Growth of two counters per second over the last `window_s` seconds.
class RateWindow {
 public:
  explicit RateWindow(double window_s = 60.0) : window_s_(window_s) {}

  /// The totals at `time_s`; call when they change.
  void add(double time_s, uint64_t env_frames, uint64_t decisions);
  double env_frames_per_s() const { return rate(&Sample::env_frames); }
  double decisions_per_s() const { return rate(&Sample::decisions); }

 private:
  struct Sample {
    double time_s;
    uint64_t env_frames;
    uint64_t decisions;
  };
  double rate(uint64_t Sample::*counter) const;
  double window_s_;
  std::deque<Sample>
      samples_;  ///< the oldest one is the newest that left the window, so the window is never empty
};

/// Means over the last `capacity` finished episodes.
class EpisodeWindow {
 public:
  explicit EpisodeWindow(int64_t capacity) : capacity_(capacity < 1 ? 1 : capacity) {}

  void add(const EpisodeRecord& episode, int num_agents);
  uint64_t episodes() const { return episodes_; }      ///< since the learner began
  std::size_t size() const { return window_.size(); }  ///< in the window
  /// Whether as many episodes are in the window as it holds: means over fewer are luck.
  bool is_full() const { return window_.size() == static_cast<std::size_t>(capacity_); }
  double score_mean() const;   ///< NaN before the first
  double return_mean() const;  ///< over episodes and agents; NaN before the first
  /// reward/reward, len/len and policy_stats/avg_true_objective with _min and _max, J as a share of the best
  /// that each map allows (over episodes on maps that say it), and the share of episodes in which some agent's
  /// return was not 0; nothing before the first.
  void append_to(MetricValues& values) const;

  /// The window as numbers, kFields of each episode, oldest first, and back. restore() keeps the newest that
  /// the window holds; those it brings do not count in episodes(). `fields` is how many numbers make an
  /// episode there: kFields, or one less in checkpoints from before the share was counted. Errors: kBadFormat
  /// for another number of them, or where the numbers are no whole episodes.
  static constexpr std::size_t kFields = 6;
  std::vector<double> state() const;
  Status restore(std::span<const double> state, std::size_t fields = kFields);

 private:
  struct Episode {
    double score;
    double return_mean;  ///< over agents
    double return_min;
    double return_max;
    double length_tics;
    double score_share;  ///< score / ceiling; NaN where the map has none
  };
  void push(const Episode& episode);

  int64_t capacity_;
  uint64_t episodes_ = 0;
  std::deque<Episode> window_;
};

}  // namespace comrad::learn
