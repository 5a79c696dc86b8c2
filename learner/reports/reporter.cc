#include "learner/reports/reporter.h"

#include <unistd.h>

#include <fstream>
#include <utility>

#include "learner/algorithms/q_learning.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/metrics/learner_messages.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/learner_report.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::learn {
namespace {

constexpr double kStatsIntervalS = 1.0;

/// Resident memory of this process, 10^6 bytes; 0 where the kernel does not report it.
double resident_megabytes() {
  std::ifstream file("/proc/self/statm");
  double pages = 0, resident_pages = 0;
  return file >> pages >> resident_pages ? resident_pages * static_cast<double>(getpagesize()) / 1e6 : 0;
}

}  // namespace

Status Reporter::open(const std::string& run_dir, const Algorithm& algorithm, const BatchSource& source,
                      LayoutService* layouts) {
  COMRAD_TRY_ASSIGN(metrics_, MetricsWriter::open(run_dir));
  COMRAD_TRY(metrics_->begin_at(totals_.env_frames + 1));  // behind the checkpoint's own report
  COMRAD_TRY(metrics_->describe_run(config_));
  algorithm_ = &algorithm;
  source_ = &source;
  layouts_ = layouts;
  return {};
}

bool Reporter::wants_values() const { return monotonic_s() - last_values_s_ >= kStatsIntervalS; }

void Reporter::updated(const UpdateStats& stats) {
  if (!stats.values.empty()) {
    update_values_ = stats.values;
    last_values_s_ = monotonic_s();
  }
  skipped_steps_ += static_cast<uint64_t>(stats.skipped_steps);
}

void Reporter::hear_episodes() {
  while (const std::optional<EpisodeRecord> episode = arena_.episodes().read(shm::EpisodeReader::kLearner))
    episodes_.add(*episode, arena_.shape().trajectory.env.num_agents);
}

void Reporter::report_if_due() {
  const double now_s = monotonic_s();
  if (now_s - last_stats_s_ >= kStatsIntervalS) {
    last_stats_s_ = now_s;
    publish_stats();
  }
  if (last_metrics_s_ == 0) last_metrics_s_ = now_s;
  if (now_s - last_metrics_s_ >= config_.run.experiment_summaries_interval) write_metrics();
}

void Reporter::report_now() {
  write_metrics();
  publish_stats();
}

void Reporter::publish_stats() {
  if (algorithm_ == nullptr) return;
  TrainStats report;
  report.time_s = totals_.train_seconds();
  report.env_frames = totals_.env_frames;
  report.decisions = totals_.decisions;
  report.learner_version = algorithm_->version();
  report.env_frames_per_s = rates_.env_frames_per_s();
  report.decisions_per_s = rates_.decisions_per_s();
  report.score_mean = episodes_.score_mean();
  report.return_mean = episodes_.return_mean();
  report.episodes = episodes_.episodes();
  report.policy_lag_mean = lag_.mean;
  report.policy_lag_max = static_cast<uint32_t>(lag_.max);
  if (const ReplayFeed* feed = source_->feed()) report.replay_filled = feed->filled();
  last_checkpoint_.copy(report.last_checkpoint, kCheckpointPathBytes - 1);
  arena_.learner_reports().publish(report);
}

void Reporter::append_replay(MetricValues& values, const ReplayFeed& feed) const {
  values.emplace_back("train/epsilon",
                      config_.q_learning.epsilon.at(static_cast<double>(totals_.env_frames)));
  if (config_.replay.per) values.emplace_back("train/per_beta", feed.beta());
  const bool mixes = config_.run.algo->mixes_q_values();
  values.emplace_back(mixes ? "train/pending_transition_debt" : "train/dqn_pending_steps",
                      feed.decisions_pending());
  if (!mixes) values.emplace_back("train/dqn_steps_per_update", feed.decisions_per_update());
  const ReplayContents contents = feed.contents();
  values.emplace_back("train/buffer_size", contents.units);
  values.emplace_back("train/buffer_transitions", contents.transitions);
  values.emplace_back("train/buffer_capacity", contents.capacity_transitions);
  values.emplace_back("train/buffer_bytes", contents.used_bytes);
  values.emplace_back("train/buffer_capacity_bytes", contents.capacity_bytes);
  values.emplace_back("train/version_diff_avg", lag_.mean);
  values.emplace_back("train/version_diff_min", static_cast<double>(lag_.min));
  values.emplace_back("train/version_diff_max", static_cast<double>(lag_.max));
}

void Reporter::append_rates(MetricValues& values, double now_s) {
  values.emplace_back("perf/_fps", rates_.env_frames_per_s());
  values.emplace_back("perf/decisions_per_s", rates_.decisions_per_s());
  uint64_t played = 0;
  for (int worker = 0; worker < arena_.shape().sim_worker_count; ++worker)
    played += arena_.sim_counters(worker).decisions.load();
  // A restarted simulator may count from 0 again; the rate of that one report is left out.
  if (last_played_s_ > 0 && now_s > last_played_s_ && played >= last_played_decisions_)
    values.emplace_back("perf/_sample_throughput",
                        static_cast<double>(played - last_played_decisions_) / (now_s - last_played_s_));
  last_played_s_ = now_s;
  last_played_decisions_ = played;
  const shm::WorkerCounters& counters = arena_.learner_counters();
  const double busy = static_cast<double>(counters.busy_ns.load()),
               wait = static_cast<double>(counters.wait_ns.load());
  if (busy + wait > 0) values.emplace_back("stats/learner_busy_fraction", busy / (busy + wait));
}

void Reporter::append_inference(MetricValues& values) {
  InferenceTotals now;
  for (int worker = 0; worker < arena_.shape().policy_worker_count; ++worker) {
    const shm::WorkerCounters& counters = arena_.policy_counters(worker);
    now.rows += counters.decisions.load();
    now.batches += counters.batches.load();
    now.wait_ns += counters.wait_ns.load();
    now.busy_ns += counters.busy_ns.load();
  }
  const InferenceTotals last = std::exchange(last_inference_, now);
  // A restarted policy worker counts some of these from 0 again; that one report has none.
  if (now.batches <= last.batches || now.rows < last.rows || now.wait_ns < last.wait_ns ||
      now.busy_ns < last.busy_ns)
    return;
  const double batches = static_cast<double>(now.batches - last.batches);
  values.emplace_back("stats/avg_request_count", static_cast<double>(now.rows - last.rows) / batches);
  values.emplace_back("stats/wait_policy", static_cast<double>(now.wait_ns - last.wait_ns) / 1e9 / batches);
  values.emplace_back("stats/step_policy", static_cast<double>(now.busy_ns - last.busy_ns) / 1e9 / batches);
}

void Reporter::write_metrics() {
  if (!metrics_) return;
  const double now_s = monotonic_s();
  MetricValues values = update_values_;
  values.emplace_back("train/env_steps", static_cast<double>(totals_.env_frames));
  values.emplace_back("train/skipped_sgd_steps", static_cast<double>(skipped_steps_));
  algorithm_->append_diagnostics(values);
  if (const ReplayFeed* feed = source_->feed()) append_replay(values, *feed);
  episodes_.append_to(values);
  append_rates(values, now_s);
  append_inference(values);
  values.emplace_back("stats/memory_learner", resident_megabytes());
  values.emplace_back("stats/batches_waiting", source_->waiting());
  values.emplace_back("stats/slabs_sealed", arena_.slabs().sealed_count());
  values.emplace_back("stats/episodes", static_cast<double>(episodes_.episodes()));
  if (layouts_ != nullptr) layouts_->append_to(values);
  values.emplace_back("stats/broken_decisions", static_cast<double>(source_->broken_decisions()));
  values.emplace_back("stats/env_frames_lost",
                      static_cast<double>(arena_.control().env_frames_lost.load(std::memory_order_relaxed)));
  last_metrics_s_ = now_s;
  warn(check_.judge(values));
  const Status written =
      metrics_->write(totals_.train_seconds(), totals_.env_frames, totals_.decisions, values);
  if (!written) spdlog::error("metrics: {}", written.error().message);
}

void Reporter::warn(const std::vector<std::string>& findings) {
  for (const std::string& finding : findings) tell_user({UserMessage::Kind::kWarning, finding});
}

}  // namespace comrad::learn
