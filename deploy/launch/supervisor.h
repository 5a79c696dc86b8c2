// Runs a run on this host to its end: waits for signals, joins, output and visitors, lets supervision.h decide what they mean,
// and reports.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/rate_meter.h"
#include "deploy/launch/run_accounts.h"
#include "deploy/launch/run_phase.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/train_stats.h"

namespace comrad::deploy {

/// How it ended.
struct RunOutcome {
  StopReason reason = StopReason::kNone;
  int exit_code = 0;
  std::string
      message;  ///< how it ended, env frames, time, both rates over the run, J, checkpoint; one line to show
  TrainStats last_stats;
  std::vector<EpisodeRecord> episodes;  ///< evaluation: all of them, ordered by episode_id
  MeasuredWindow measured;
  double lag_mean = 0;
  DecisionAccounts accounts = {};  ///< of training: where every decision went
  uint64_t env_frames_lost = 0;  ///< trained on, then forgotten by a learner that went back to its checkpoint
  uint32_t restarts = 0;
};

/// Runs the plan to its end. SIGINT and SIGTERM: finish the optimizer step, checkpoint, flush, stop within 10
/// s, or as soon as a slow machine lets the learner save; a second SIGINT stops at once. A dead simulator or policy worker is restarted with back-off; a dead
/// learner is restarted from the last checkpoint. Children die with this process. Errors: kNoSpace (arena),
/// kSystem (sockets), kPeerLost (a worker that keeps dying; its last log line).
Expected<RunOutcome> run(const LaunchPlan& plan);

}  // namespace comrad::deploy
