// What the learner reports of itself once a second, for the supervisor.
//
//   sequence (odd while the learner writes) | TrainStats
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include "rollout_buffer/schema/train_stats.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::shm {

struct Region;

struct ReportBlock {
  alignas(kCacheLineBytes) std::atomic<uint64_t> sequence;  ///< odd: being written; 0: none yet
  TrainStats report;
};
static_assert(sizeof(ReportBlock) == 10 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// Behind a sequence lock: one writer (the learner), one reader (the supervisor).
class LearnerReports {
 public:
  explicit LearnerReports(Region& region);

  void publish(const TrainStats& report) const;
  /// The newest report if `sequence` is not its number, which is stored there; nothing otherwise, or while one
  /// is being written (a learner killed half way leaves none until its successor speaks).
  std::optional<TrainStats> read(uint64_t& sequence) const;

 private:
  ReportBlock* block_;
};

}  // namespace comrad::shm
