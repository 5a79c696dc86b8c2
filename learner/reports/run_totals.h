// What a run has learned from, its earlier processes included. Kept in checkpoints.
#pragma once

#include <cstdint>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

struct RunTotals {
  uint64_t env_frames = 0;
  uint64_t decisions = 0;
  double seconds_before = 0;         ///< of training, in earlier processes
  double started_s = monotonic_s();  ///< of this process

  double train_seconds() const { return seconds_before + monotonic_s() - started_s; }
  /// Whether a limit of the run is reached.
  bool reach_the_goal_of(const RunConfig& config) const {
    if (static_cast<double>(env_frames) >= config.run.train_for_env_frames) return true;
    return config.run.train_for_seconds > 0 && train_seconds() >= config.run.train_for_seconds;
  }
};

}  // namespace comrad::learn
