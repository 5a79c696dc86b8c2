// `comrad bench check`: holds what does not depend on the machine. Ratios of interleaved measurements in processor seconds, so
// that a busy or slow host changes both sides alike.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/bench/bench_parts.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Share of the rate that a pipeline would have if its parts cost what they cost alone and no core of it were ever idle:
///
///   limit = free core seconds / sum of the parts' processor seconds a decision
///
/// `parts`: the objects of bench sim, inference and learner; `train`: of bench train. Free are the seconds of all cores less
/// those that other programs took.
double share_of_limit(const std::vector<nlohmann::ordered_json>& parts, const nlohmann::ordered_json& train);

/// One thing that is held.
struct BenchBound {
  std::string name;
  double bound;
  bool is_at_most;                    ///< else at least
  std::string how;                    ///< what is divided by what
  std::vector<double> measured = {};  ///< by round

  double value() const;  ///< median of the rounds
  bool holds() const;
};

/// Names, bounds and reasons, with nothing measured. `frame_bytes` of one agent's picture.
std::vector<BenchBound> bench_bounds(double frame_bytes);

/// Measures round after round, the parts of a ratio one after the other, until the medians hold, at least `rounds_min` and at
/// most `rounds_max` rounds. The object has a table `checks` and `holds`. Errors: those of measure_bench().
Expected<nlohmann::ordered_json> measure_checks(const BenchRequest& request, int rounds_min, int rounds_max);

}  // namespace comrad::deploy
