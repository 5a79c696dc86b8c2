#include "learner/losses/q_scale.h"

#include <algorithm>
#include <cmath>

namespace comrad::learn {
namespace {

constexpr double kBeta = 1e-3;
constexpr double kYoungWeight = 0.06;  ///< of some 60 updates
constexpr PolicyVersion kMoveEvery = 64;
constexpr double kLeastSigma = 1e-4;
constexpr double kMostSigma = 1e6;

}  // namespace

void QScale::begin(double reward_rms) {
  if (!(reward_rms > 0) || !std::isfinite(reward_rms)) return;
  sigma_ = std::clamp(reward_rms, kLeastSigma, kMostSigma);
  has_begun_ = true;
}

void QScale::begin_natural() {
  *this = QScale();
  has_begun_ = true;
}

void QScale::observe(double target_mean_square) {
  if (!has_begun_ || !std::isfinite(target_mean_square)) return;
  mean_square_ += kBeta * (target_mean_square - mean_square_);
  weight_ += kBeta * (1 - weight_);
}

bool QScale::is_due(PolicyVersion version) const {
  return weight_ < kYoungWeight || version % kMoveEvery == 0;
}

double QScale::move() {
  if (weight_ > 0) sigma_ = std::clamp(std::sqrt(mean_square_ / weight_), kLeastSigma, kMostSigma);
  return sigma_;
}

void QScale::save(StateDict& state) const {
  state.put("q_scale/sigma", sigma_);
  state.put("q_scale/mean_square", mean_square_);
  state.put("q_scale/weight", weight_);
  state.put("q_scale/has_begun", int64_t{has_begun_});
}

Expected<QScale> QScale::load(const StateDict& state) {
  QScale scale;
  COMRAD_TRY_ASSIGN(scale.sigma_, state.number("q_scale/sigma"));
  COMRAD_TRY_ASSIGN(scale.mean_square_, state.number("q_scale/mean_square"));
  COMRAD_TRY_ASSIGN(scale.weight_, state.number("q_scale/weight"));
  COMRAD_TRY_ASSIGN(const int64_t has_begun, state.integer("q_scale/has_begun"));
  scale.has_begun_ = has_begun != 0;
  const bool is_sound = scale.sigma_ >= kLeastSigma && scale.sigma_ <= kMostSigma &&
                        scale.mean_square_ >= 0 && std::isfinite(scale.mean_square_) && scale.weight_ >= 0 &&
                        scale.weight_ <= 1;
  if (!is_sound) return Error{ErrorCode::kBadFormat, "q_scale: the unit of Q-values is out of range"};
  return scale;
}

}  // namespace comrad::learn
