// What the learner reports of itself once a second, for the supervisor.
//
//   sequence (odd while the learner writes) | LearnerReport
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "rollout_buffer/schema/version.h"

namespace comrad::shm {

struct Region;

constexpr std::size_t kCheckpointPathBytes = 512;

struct LearnerReport {
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

struct ReportBlock {
  alignas(kCacheLineBytes) std::atomic<uint64_t> sequence;  ///< odd: being written; 0: none yet
  LearnerReport report;
};
static_assert(sizeof(ReportBlock) == 10 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// Behind a sequence lock: one writer (the learner), one reader (the supervisor).
class LearnerReports {
 public:
  explicit LearnerReports(Region& region);

  void publish(const LearnerReport& report) const;
  /// The newest report if `sequence` is not its number, which is stored there; nothing otherwise, or while one
  /// is being written (a learner killed half way leaves none until its successor speaks).
  std::optional<LearnerReport> read(uint64_t& sequence) const;

 private:
  ReportBlock* block_;
};

}  // namespace comrad::shm
