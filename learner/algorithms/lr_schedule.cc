#include "learner/algorithms/lr_schedule.h"

#include <algorithm>
#include <cmath>

namespace comrad::learn {
namespace {

constexpr double kAdaptiveFactor = 1.5;

}  // namespace

LrSchedule::LrSchedule(const RunConfig& config)
    : initial_(config.learning_rate),
      learning_rate_(config.learning_rate),
      env_frames_total_(config.train_for_env_steps),
      kl_threshold_(config.lr_schedule_kl_threshold),
      min_(config.lr_adaptive_min),
      max_(config.lr_adaptive_max) {
  if (config.lr_schedule == "linear_decay") kind_ = Kind::kLinearDecay;
  if (config.lr_schedule == "kl_adaptive_minibatch") kind_ = Kind::kKlMinibatch;
  if (config.lr_schedule == "kl_adaptive_epoch") kind_ = Kind::kKlEpoch;
}

void LrSchedule::before_batch(double env_frames) {
  if (kind_ != Kind::kLinearDecay || !(env_frames_total_ > 0)) return;
  learning_rate_ = initial_ * std::max(0.0, 1.0 - env_frames / env_frames_total_);
}

void LrSchedule::after_minibatch(double kl) {
  if (kind_ == Kind::kKlMinibatch) adapt(kl);
}

void LrSchedule::after_epoch(double mean_kl) {
  if (kind_ == Kind::kKlEpoch) adapt(mean_kl);
}

void LrSchedule::adapt(double kl) {
  if (!std::isfinite(kl)) return;
  if (kl > 2.0 * kl_threshold_) learning_rate_ = std::max(learning_rate_ / kAdaptiveFactor, min_);
  if (kl < 0.5 * kl_threshold_) learning_rate_ = std::min(learning_rate_ * kAdaptiveFactor, max_);
}

}  // namespace comrad::learn
