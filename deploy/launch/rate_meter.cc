#include "deploy/launch/rate_meter.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "deploy/launch/progress.h"
#include "rollout_buffer/shm/learner_report.h"

namespace comrad::deploy {

void RateMeter::use(const shm::Arena* arena) {
  accounts_.use(arena, trained_decisions_.total());
  arena_ = arena;
  learner_epoch_ = 0;
  report_sequence_ = 0;
  played_decisions_.start_from(0);
  if (arena_ != nullptr) arena_->control().env_frames_lost.store(env_frames_lost_);
}

uint64_t RateMeter::simulators_decisions() const {
  uint64_t sum = 0;
  for (int sim = 0; sim < arena_->shape().sim_worker_count; ++sim)
    sum += arena_->sim_counters(sim).decisions.load(std::memory_order_relaxed);
  return sum;
}

bool RateMeter::count() {
  if (arena_ == nullptr) return false;
  played_decisions_.see(simulators_decisions());
  // A learner sets its counters to those of the checkpoint it resumes, then its state to running.
  const shm::WorkerCounters& learner = arena_->learner_counters();
  if (learner.state.load(std::memory_order_acquire) < shm::WorkerState::kRunning) return false;
  const uint64_t trained = learner.decisions.load(std::memory_order_relaxed);
  const uint64_t updates = learner.batches.load(std::memory_order_relaxed);
  uint64_t fallen = 0;
  if (const uint32_t epoch = learner.epoch.load(); std::exchange(learner_epoch_, epoch) != epoch) {
    // Where it began, for it may have trained on something already.
    fallen = trained_decisions_.start_from(
        std::min(trained, arena_->control().learner_decisions_before.load(std::memory_order_relaxed)));
    trained_updates_.start_from(updates);
  }
  fallen += trained_decisions_.see(trained);
  trained_updates_.see(updates);
  if (fallen == 0 || !plan_.trains()) return false;
  // A learner that starts again has forgotten what it learned since its last checkpoint.
  ++goings_back_;
  accounts_.forgot(fallen);
  env_frames_lost_ += fallen * static_cast<uint64_t>(plan_.config.environment.env_frameskip);
  arena_->control().env_frames_lost.store(env_frames_lost_);
  // The dead one's last report is no longer true; the new one's comes later.
  last_stats_.env_frames = arena_->control().learner_env_frames.load(std::memory_order_relaxed);
  last_stats_.decisions = trained_decisions_.seen();
  return true;
}

uint64_t RateMeter::learner_ended() {
  count();
  return plan_.trains() ? accounts_.learner_ended(trained_decisions_.total()) : 0;
}

void RateMeter::close() {
  count();
  if (plan_.drains()) accounts_.close(trained_decisions_.total());
}

bool RateMeter::take_report() {
  if (arena_ == nullptr) return false;
  const std::optional<TrainStats> report = arena_->learner_reports().read(report_sequence_);
  if (!report) return false;
  last_stats_ = *report;
  // A byte in shared memory may be anything.
  if (!(report->replay_filled >= 0 && report->replay_filled < 1)) last_stats_.replay_filled = 1;
  if (window_began_s_ > 0 && std::isfinite(report->policy_lag_mean)) {
    lag_sum_ += report->policy_lag_mean;
    ++lag_count_;
  }
  return true;
}

void RateMeter::add(const EpisodeRecord& episode) { episodes_.emplace(episode.episode_id, episode); }

/// How many times its length a window waits for the update that closes it.
constexpr double kPatience = 10;

bool RateMeter::measure(double now_s) {
  const bool has_begun = plan_.trains() ? trained_updates_.total() > 0 : played_decisions_.total() > 0;
  if (has_begun && first_work_s_ == 0) first_work_s_ = now_s;
  if (plan_.seconds <= 0 || first_work_s_ == 0 || window_.seconds > 0) return false;
  // Decisions come a batch at a time: a window from update to update holds whole ones and the time that they took.
  const bool is_edge = std::exchange(decisions_at_last_look_, decisions()) != decisions();
  if (window_began_s_ == 0) {
    if (now_s < first_work_s_ + plan_.warmup_seconds || !is_edge) return false;
    window_began_s_ = now_s;
    decisions_before_window_ = decisions();
    updates_before_window_ = trained_updates_.total();
    parts_ = BenchWindows(plan_.seconds);
    usage_before_window_ = read_usage(plan_.run_dir, *arena_);
    gpu_load_.emplace();
    return false;
  }
  const auto done = static_cast<double>(decisions() - decisions_before_window_);
  if (is_edge) parts_.see(done, now_s - window_began_s_);
  if (now_s < window_began_s_ + (is_edge ? 1 : kPatience) * plan_.seconds) return false;
  window_ = {.seconds = now_s - window_began_s_,
             .decisions = decisions() - decisions_before_window_,
             .updates = trained_updates_.total() - updates_before_window_,
             .windows = parts_.rates(),
             .usage = usage_between(usage_before_window_, read_usage(plan_.run_dir, *arena_)),
             .gpu_busy = gpu_load_->busy()};
  gpu_load_.reset();
  if (window_.windows.empty()) window_.windows = {done / window_.seconds};
  return true;
}

uint64_t RateMeter::decisions_of_run() const {
  return std::max(last_stats_.decisions, trained_decisions_.seen());
}

uint64_t RateMeter::env_frames() const {
  const uint64_t live =
      arena_ == nullptr ? 0 : arena_->control().learner_env_frames.load(std::memory_order_relaxed);
  return std::max(live, last_stats_.env_frames);
}

double RateMeter::episode_score_mean() const {
  double sum = 0;
  for (const auto& [id, episode] : episodes_) sum += episode.score;
  return episodes_.empty() ? std::nan("") : sum / static_cast<double>(episodes_.size());
}

double RateMeter::lag_mean() const {
  return lag_count_ > 0 ? lag_sum_ / lag_count_ : last_stats_.policy_lag_mean;
}

std::string RateMeter::going_back_text() const {
  if (goings_back_ == 0) return "";
  return "learner went back " + count_text(static_cast<double>(env_frames_lost_)) +
         " env frames to its last checkpoint" +
         (goings_back_ > 1 ? fmt::format(", in {} restarts", goings_back_) : "");
}

std::string RateMeter::unsaved_text() const {
  const uint64_t saved =
      arena_ == nullptr ? 0 : arena_->control().saved_env_frames.load(std::memory_order_relaxed);
  const uint64_t now = env_frames();
  return count_text(static_cast<double>(now > saved ? now - saved : 0)) + " env frames since " +
         (saved > 0 ? "the one at " + count_text(static_cast<double>(saved)) : "the run's beginning") +
         " are lost";
}

std::string RateMeter::limit_reached() const {
  const RunConfig& config = plan_.config;
  if (static_cast<double>(env_frames()) >= config.run.train_for_env_frames)
    return fmt::format(" (--train_for_env_frames {})", std::llround(config.run.train_for_env_frames));
  if (config.run.train_for_seconds > 0)
    return fmt::format(" (--train_for_seconds {})", config.run.train_for_seconds);
  return "";
}

}  // namespace comrad::deploy
