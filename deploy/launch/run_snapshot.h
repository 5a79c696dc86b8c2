// The state of a running run at one moment, for monitoring: `comrad ctl RUN status`, `comrad top`
// and the Prometheus page say it in three ways.
#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/rate_meter.h"
#include "deploy/launch/run_accounts.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::deploy {

struct WorkerSnapshot {
  std::string name;  ///< "sim-0"
  std::string role;  ///< "sim", "policy", "learner"
  std::string host;
  std::string state;       ///< starting, running, stopped (SIGSTOP), restarting
  int64_t pid = 0;         ///< 0: none now
  uint64_t decisions = 0;  ///< its counter; a learner's goes back with it
  double decisions_per_s = 0;
  double busy = 0;  ///< share of the last second or so that it did not wait for others, 0 to 1
  int restarts = 0;
  double silent_s = 0;  ///< since its counter moved last
  double cpu_s = 0;
  uint64_t resident_bytes = 0;
};

/// One host of the run.
struct HostSnapshot {
  std::string name;
  int workers = 0;  ///< alive
  int restarts = 0;
  double decisions_per_s = 0;
  int64_t credits =
      0;  ///< trajectories that its simulators may still begin or send before the learner takes some
};

struct RunSnapshot {
  std::string run, run_dir, host;
  int64_t pid = 0;  ///< of the supervisor
  RunStatus status;
  int64_t frame_skip = 1;
  double env_frames_goal = 0;  ///< train_for_env_frames
  double decisions_per_s = 0;
  double lag_mean = std::nan("");
  uint32_t lag_max = 0;
  uint64_t episodes = 0;
  double replay_filled = 1;
  shm::SlabCounts slabs;
  uint64_t decisions_waiting = 0;  ///< in sealed slabs and in the learner
  DecisionAccounts accounts;
  uint64_t env_frames_lost = 0;
  uint32_t checkpoint_asked = 0, checkpoint_done = 0, checkpoints_failed = 0;
  uint64_t saved_env_frames = 0;
  std::string last_checkpoint;
  std::string silence;
  int restarts = 0;
  std::vector<HostSnapshot> hosts;
  std::vector<WorkerSnapshot> workers;
};

/// One JSON object on one line, as rollout_buffer/FORMATS.md does not fix it: it lives as long as the answer to a question.
std::string to_json(const RunSnapshot& run);

/// Takes snapshots of one run; what the references name outlives it. Threads: the supervisor's.
class SnapshotTaker {
 public:
  SnapshotTaker(const LaunchPlan& plan, const RateMeter& meter, const WorkerTable& table)
      : plan_(plan), meter_(meter), table_(table) {}

  /// Once a second or so: rates of workers are between two looks.
  void look(const shm::Arena& arena, double now_s);
  RunSnapshot take(const shm::Arena& arena, const RunStatus& status, double now_s) const;

 private:
  struct Look {
    uint64_t decisions = 0, busy_ns = 0, wait_ns = 0;
    double decisions_per_s = 0, busy = 0;
  };
  struct PeerLook {
    uint64_t decisions = 0;  ///< delivered
    int workers = 0;
    int64_t credits = 0;
    double decisions_per_s = 0;
  };
  const LaunchPlan& plan_;
  const RateMeter& meter_;
  const WorkerTable& table_;
  std::map<std::string, Look> looks_;
  std::map<std::string, PeerLook> peers_;  ///< other hosts that feed, by name
  double looked_s_ = 0;
};

}  // namespace comrad::deploy
