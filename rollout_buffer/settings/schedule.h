// A setting that may change while a run continues: one number, or numbers at env frames with steps or straight lines between them.
//
//   4e-4                      the same all the time
//   0@0,3@2.4e6               0, from 2.4 M env frames on 3
//   0.01@0..0.003@2e6         in a line from 0.01 to 0.003, which stays
//
// A value is a function of the env frames that the learner has counted and of nothing else: a resumed run, and every host of a run, has
// the same one. Stage: before a run (text), collect and update (values).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

class Schedule {
 public:
  struct Point {
    double value = 0;
    double env_frames = 0;
    bool ends_a_line =
        false;  ///< the way from the point before is a straight line; else its value holds until here
    bool operator==(const Point&) const = default;
  };

  /// The same value all the time. Not explicit: where a setting is a number, it stays one in code.
  Schedule(double value = 0) : points_{{.value = value}} {}  // NOLINT(google-explicit-constructor)
  /// From `start` at env frame 0 in a straight line to `end`, which stays.
  static Schedule line(double start, double end, double env_frames);
  /// Errors: kBadInput, saying what is allowed, for text that is no number and no list of VALUE@ENV_FRAMES whose env frames grow from 0
  /// or later to at most 1e15, or one of more than 64 points.
  static Expected<Schedule> parse(std::string_view text);

  /// The value after so many env frames of the run; that of the first point before it.
  double at(double env_frames) const;
  /// The nearest whole number to it, for settings that count.
  int64_t rounded_at(double env_frames) const;
  bool is_constant() const { return points_.size() == 1; }
  double last() const { return points_.back().value; }
  /// At least one, by env frames.
  const std::vector<Point>& points() const { return points_; }
  /// What parse() reads back without loss.
  std::string text() const;

  bool operator==(const Schedule&) const = default;

 private:
  std::vector<Point> points_;
};

}  // namespace comrad
