// What a page shows of a run while that trains, read from its files and its control socket; nothing is written.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Threads: one.
class WatchedRun {
 public:
  /// `run_dir` of a run; empty: there is none.
  explicit WatchedRun(std::string run_dir) : run_dir_(std::move(run_dir)) {}

  /// Looks again: {"type": "run", "name", "state", "status": the supervisor's answer or null, "curves": {"env_frames": [...],
  /// "J": [...], "return": [...], "env_frames_per_s": [...], "lag": [...]}}. A curve has at most kPointsMax points.
  nlohmann::json look();
  /// The newest checkpoint; empty where there is none.
  std::string newest_checkpoint() const;

  static constexpr std::size_t kPointsMax = 400;

 private:
  void read_metrics();
  std::string run_dir_;
  int64_t offset_ = 0;  ///< of metrics.jsonl that was read
  uint64_t reports_ = 0, keep_every_ = 1;
  std::vector<std::vector<double>> points_;  ///< [report kept][curve]
};

}  // namespace comrad::deploy
