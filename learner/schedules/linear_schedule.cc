#include "learner/schedules/linear_schedule.h"

#include <algorithm>
#include <cmath>

namespace comrad::learn {

LinearSchedule::LinearSchedule(double start, double end, double horizon_frames)
    : start_(start), end_(end), horizon_frames_(horizon_frames), anchor_value_(start) {}

double LinearSchedule::at(double env_frames) const {
  if (env_frames >= horizon_frames_) return end_;
  // Here horizon_frames_ > env_frames, so the way is longer than 0 wherever it is divided by.
  const double way = std::max(0.0, env_frames - anchor_frames_);
  if (way == 0) return anchor_value_;
  return anchor_value_ + (end_ - anchor_value_) * way / (horizon_frames_ - anchor_frames_);
}

void LinearSchedule::save(StateDict& state, const std::string& prefix) const {
  state.put(prefix + "_start", start_);
  state.put(prefix + "_end", end_);
  state.put(prefix + "_horizon_frames", horizon_frames_);
  state.put(prefix + "_anchor_frames", anchor_frames_);
  state.put(prefix + "_anchor_value", anchor_value_);
}

Status LinearSchedule::load(const StateDict& state, const std::string& prefix, double env_frames) {
  if (!state.has(prefix + "_start")) return {};
  LinearSchedule saved(0, 0, 0);
  COMRAD_TRY_ASSIGN(saved.start_, state.number(prefix + "_start"));
  COMRAD_TRY_ASSIGN(saved.end_, state.number(prefix + "_end"));
  COMRAD_TRY_ASSIGN(saved.horizon_frames_, state.number(prefix + "_horizon_frames"));
  COMRAD_TRY_ASSIGN(saved.anchor_frames_, state.number(prefix + "_anchor_frames"));
  COMRAD_TRY_ASSIGN(saved.anchor_value_, state.number(prefix + "_anchor_value"));
  for (const double number :
       {saved.start_, saved.end_, saved.horizon_frames_, saved.anchor_frames_, saved.anchor_value_})
    if (!std::isfinite(number)) return Error{ErrorCode::kBadFormat, prefix + ": a number is not finite"};
  if (saved.start_ != start_ || saved.end_ != end_) return {};
  if (saved.horizon_frames_ == horizon_frames_) {
    *this = saved;
    return {};
  }
  anchor_frames_ = env_frames;
  anchor_value_ = saved.at(env_frames);
  return {};
}

}  // namespace comrad::learn
