// The learner's report of itself, once a second. The learner writes it into the arena, the supervisor reads it there.
#pragma once

#include <cstddef>
#include <cstdint>

namespace comrad {

constexpr std::size_t kCheckpointPathBytes = 512;

/// Trivially copyable; it lies in the arena (shm/learner_report.h).
struct TrainStats {
  double time_s = 0;  ///< of training, earlier processes included
  uint64_t env_frames = 0;
  uint64_t decisions = 0;
  double env_frames_per_s = 0;
  double decisions_per_s = 0;
  double score_mean = 0;  ///< J over the last stats_avg episodes; NaN before the first
  double return_mean = 0;
  uint64_t episodes = 0;
  double policy_lag_mean = 0;
  double replay_filled = 1;  ///< share of the decisions that learning waits for; 1: it waits for none
  uint32_t learner_version = 0;
  uint32_t policy_lag_max = 0;
  char last_checkpoint[kCheckpointPathBytes] = {};  ///< ends in 0; a longer path is cut
};
static_assert(sizeof(TrainStats) == 88 + kCheckpointPathBytes, "changing this bumps kArenaVersion");

}  // namespace comrad
