// A learner beside the first: it drains its own share of the slabs and takes every optimizer step with the others. It
// publishes, saves and reports nothing, and ends when the first one requests it. Stage: drain > sample > update.
#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "learner/algorithms/algorithm.h"
#include "learner/ranks/rank_group.h"
#include "learner/reports/run_totals.h"
#include "learner/sources/batch_source.h"
#include "learner/sources/layout_service.h"
#include "learner/sources/stop_signal.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

class Follower {
 public:
  /// Begins where the first learner does. `stop` is raised by a signal handler, `ranks` outlives the object.
  /// Errors: those of Learner::start, but for what only the first one opens.
  static Expected<std::unique_ptr<Follower>> start(const std::string& run_dir, const RunConfig& config,
                                                   shm::Arena arena, const std::atomic<bool>& stop,
                                                   RankGroup& ranks);
  /// Trains until a stop is requested. Errors: those of an update; kPeerLost where another learner has left.
  Status run();

  const Algorithm& algorithm() const { return *algorithm_; }

 private:
  Follower(const RunConfig& config, shm::Arena arena, const std::atomic<bool>& stop, RankGroup& ranks);
  Status open(const std::string& run_dir);
  Status begin();
  void take_in(const Inserted& inserted);
  Status update(Sample& sample);
  void count(int64_t transitions);
  Status watch();

  const RunConfig config_;
  const bool lock_step_;
  shm::Arena arena_;
  const std::atomic<bool>& stop_requested_;
  StopSignal stop_;
  RankGroup& ranks_;
  RunTotals totals_;
  std::unique_ptr<Algorithm> algorithm_;
  std::unique_ptr<LayoutService> layouts_;  ///< for PLR's scores; null: the run plays one map
  std::unique_ptr<BatchSource> source_;
};

}  // namespace comrad::learn
