// What the learner publishes: its report in the arena once a second, metrics.jsonl with TensorBoard scalars, and
// warnings for the user. Stage: beside update.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/reports/learning_check.h"
#include "learner/reports/metrics.h"
#include "learner/reports/run_totals.h"
#include "learner/sources/batch_source.h"
#include "learner/sources/layout_service.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

/// Threads: the learner's.
class Reporter {
 public:
  /// What the references name outlives the reporter.
  Reporter(const RunConfig& config, const RunTotals& totals, const shm::Arena& arena)
      : config_(config), totals_(totals), arena_(arena), episodes_(config.run.stats_avg), check_(config) {}

  /// What reports are about, once it is there: the algorithm, its batches, its layouts (null: one map). Opens the
  /// files of `run_dir`. Without this, as for a learner that only serves, nothing is published.
  /// Errors: those of MetricsWriter::open.
  Status open(const std::string& run_dir, const Algorithm& algorithm, const BatchSource& source,
              LayoutService* layouts);

  /// Warns of what the settings alone show.
  void judge_settings() { warn(check_.judge_settings()); }

  /// The totals have grown.
  void counted() { rates_.add(monotonic_s(), totals_.env_frames, totals_.decisions); }
  void heard_lag(const LagStats& lag) { lag_ = lag; }
  /// Whether the next update should say what it did: once a second is enough.
  bool wants_values() const;
  void updated(const UpdateStats& stats);
  void saved(const std::string& checkpoint) { last_checkpoint_ = checkpoint; }

  /// Takes the episodes that have ended since.
  void hear_episodes();
  EpisodeWindow& episodes() { return episodes_; }
  const EpisodeWindow& episodes() const { return episodes_; }

  /// Reports where it is time: the arena every second, metrics at experiment_summaries_interval.
  void report_if_due();
  /// The last report of a run.
  void report_now();
  /// What the supervisor hears once a second, now.
  void publish_stats();

 private:
  void write_metrics();
  void append_replay(MetricValues& values, const ReplayFeed& feed) const;
  void append_rates(MetricValues& values, double now_s);
  void append_inference(MetricValues& values);
  void warn(const std::vector<std::string>& findings);

  const RunConfig& config_;
  const RunTotals& totals_;
  const shm::Arena& arena_;
  const Algorithm* algorithm_ = nullptr;
  const BatchSource* source_ = nullptr;
  LayoutService* layouts_ = nullptr;
  std::optional<MetricsWriter> metrics_;
  RateWindow rates_;
  EpisodeWindow episodes_;
  LearningCheck check_;
  NamedNumbers update_values_;  ///< of the last update that said them
  LagStats lag_;                // of the newest data
  uint64_t skipped_steps_ = 0;
  std::string last_checkpoint_;
  double last_values_s_ = 0, last_stats_s_ = 0, last_metrics_s_ = 0;
  double last_played_s_ = 0;
  uint64_t last_played_decisions_ = 0;
  /// Of all policy workers together, since they began.
  struct InferenceTotals {
    uint64_t rows = 0, batches = 0, wait_ns = 0, busy_ns = 0;
  } last_inference_;
};

}  // namespace comrad::learn
