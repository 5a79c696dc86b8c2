// A setting that moves in a line over the run's env frames (the importance weights' exponent, the learning
// rate). The end of that line is the end of the run, and a run may be given a later end when it is resumed: then
// the line continues from where it stood, instead of jumping to where it would stand on a line of another length.
// Stage: update, checkpoint.
#pragma once

#include <string>

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::learn {

/// value(f) = anchor_value + (end - anchor_value) * (f - anchor_frames) / (horizon_frames - anchor_frames),
/// held at anchor_value before anchor_frames and at `end` from horizon_frames on. A fresh line is anchored at
/// frame 0 with `start`.
class LinearSchedule {
 public:
  /// `start` at env frame 0, `end` from `horizon_frames` on (at once where that is 0 or less).
  LinearSchedule(double start, double end, double horizon_frames);

  double at(double env_frames) const;
  double horizon_frames() const { return horizon_frames_; }

  /// Puts the line under `prefix` ("replay/beta").
  void save(StateDict& state, const std::string& prefix) const;
  /// Continues from a checkpoint made at `env_frames`. A line with the same start, end and horizon is taken over
  /// as it was, to the last bit. Where only the horizon is another, the line is anchored here: it stands at the
  /// saved line's value now and reaches `end` at the new horizon. Where `start` or `end` differs, the user
  /// set it, and this object stays as it was made; so it does for a checkpoint that has no such line.
  /// Errors: kBadFormat for keys of another type and numbers that are not finite.
  Status load(const StateDict& state, const std::string& prefix, double env_frames);

 private:
  double start_, end_, horizon_frames_;
  double anchor_frames_ = 0;
  double anchor_value_;
};

}  // namespace comrad::learn
