#include "learner/schedules/lr_schedule.h"

#include <algorithm>
#include <cmath>

namespace comrad::learn {
namespace {

constexpr double kAdaptiveFactor = 1.5;

}  // namespace

LrSchedule::LrSchedule(const RunConfig& config)
    : kind_(config.optimisation.lr_schedule),
      rate_(config.optimisation.learning_rate),
      learning_rate_(rate_.at(0)),
      line_(learning_rate_, 0.0, config.run.train_for_env_frames),
      kl_threshold_(config.optimisation.lr_schedule_kl_threshold),
      min_(config.optimisation.lr_adaptive_min),
      max_(config.optimisation.lr_adaptive_max) {}

void LrSchedule::before_batch(double env_frames) {
  env_frames_ = env_frames;
  if (kind_ == RateSchedule::kConstant) learning_rate_ = rate_.at(env_frames);
  if (kind_ == RateSchedule::kLinearDecay) learning_rate_ = line_.at(env_frames);
}

void LrSchedule::after_minibatch(double kl) {
  if (kind_ == RateSchedule::kKlAdaptiveMinibatch) adapt(kl);
}

void LrSchedule::after_epoch(double mean_kl) {
  if (kind_ == RateSchedule::kKlAdaptiveEpoch) adapt(mean_kl);
}

void LrSchedule::save(StateDict& state) const {
  state.put("schedule/learning_rate", learning_rate_);
  if (kind_ != RateSchedule::kLinearDecay) return;
  state.put("schedule/env_frames", env_frames_);
  line_.save(state, "schedule/line");
}

Status LrSchedule::load(const StateDict& state) {
  COMRAD_TRY_ASSIGN(const double learning_rate, state.number("schedule/learning_rate"));
  if (follows_kl(kind_)) learning_rate_ = learning_rate;
  if (kind_ != RateSchedule::kLinearDecay || !state.has("schedule/env_frames")) return {};
  COMRAD_TRY_ASSIGN(env_frames_, state.number("schedule/env_frames"));
  COMRAD_TRY(line_.load(state, "schedule/line", env_frames_));
  learning_rate_ = line_.at(env_frames_);
  return {};
}

void LrSchedule::adapt(double kl) {
  if (!std::isfinite(kl)) return;
  if (kl > 2.0 * kl_threshold_) learning_rate_ = std::max(learning_rate_ / kAdaptiveFactor, min_);
  if (kl < 0.5 * kl_threshold_) learning_rate_ = std::min(learning_rate_ * kAdaptiveFactor, max_);
}

}  // namespace comrad::learn
