// The learner process: drains sealed trajectories, updates the algorithm, publishes weights, keeps
// checkpoints and reports. Stage: drain > sample > update > publish. Asynchronous mode takes slabs as they
// come; lock step (deterministic, or async_rl off) waits for one rollout of every environment, trains on it
// in a fixed order and only then lets the next one begin.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/ranks/rank_group.h"
#include "learner/reports/reporter.h"
#include "learner/reports/run_totals.h"
#include "learner/sources/batch_source.h"
#include "learner/sources/layout_service.h"
#include "learner/sources/stop_signal.h"
#include "learner/worker/checkpoint_keeper.h"
#include "learner/worker/weights_publisher.h"
#include "policy_workers/batching/slab_frames.h"
#include "policy_workers/worker/policy_threads.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

struct LearnerOptions {
  std::string run_dir;
  bool serve = false;      ///< publish a checkpoint and idle, instead of training
  std::string checkpoint;  ///< serve: the file; train: where to begin when the run has no checkpoint yet
  double abandon_step_after_s =
      4;  ///< of a stop: the optimizer step, or in lock step the rollout, is given up
  /// The learners of which this one is the first; null: it is alone. Outlives the learner.
  RankGroup* ranks = nullptr;
  std::function<Status()> check_others = {};  ///< kPeerLost once another learner has ended
};

/// One learner. Made by start(), which leaves weights published and simulators allowed to begin.
class Learner {
 public:
  /// Opens everything in the order that others depend on: algorithm, checkpoint, weights, journals,
  /// permission. `stop` is raised by a signal handler. Errors: kBadInput (settings, arena of another shape),
  /// kBadFormat (checkpoint), kUnsupported (device), kSystem.
  static Expected<std::unique_ptr<Learner>> start(const LearnerOptions& options, const RunConfig& config,
                                                  shm::Arena arena, const std::atomic<bool>& stop);

  /// Trains (or serves) until the run's end or a stop; saves the last checkpoint.
  /// Errors: kBadInput when training diverged, kNotSaved when the last checkpoint could not be written; those of
  /// PolicyThreads.
  Status run();

  uint64_t env_frames() const { return totals_.env_frames; }
  const Algorithm& algorithm() const { return *algorithm_; }

 private:
  Learner(const LearnerOptions& options, const RunConfig& config, shm::Arena arena,
          const std::atomic<bool>& stop);

  // Start.
  Status open();
  Status make_network();
  void map_frames();
  Status check_arena() const;
  Status resume();
  /// `is_own`: a checkpoint of this run, rather than one of another's to begin from.
  Status load(const CheckpointKeeper::Found& found, bool is_own);
  Status load(const std::string& path, bool is_own);
  Status prepare_training();

  // Run.
  Status train();
  Status serve();
  void take_in(const Inserted& inserted);
  Expected<UpdateStats> update(Sample& sample);
  Status check_others();
  Expected<UpdateStats> left_by_others(const Error& why, UpdateStats stats);
  UpdateContext update_context();
  void offer_weights();
  void publish(std::span<const std::byte> weights, PolicyVersion version);
  void close_rollout();
  void give_up_rollout();
  bool wait_while_paused();

  // What all do now and then.
  void count(int64_t transitions);
  void poll();
  StateDict state() const;
  void save_if_due();
  void note_saved();
  bool is_finished() const { return totals_.reach_the_goal_of(config_); }

  const LearnerOptions options_;
  const RunConfig config_;
  const bool lock_step_;
  const bool has_policy_threads_;  ///< else policy workers are processes
  RankGroup alone_;
  RankGroup& ranks_;
  shm::Arena arena_;
  StopSignal stop_;
  RunTotals totals_;
  Reporter reporter_;
  CheckpointKeeper checkpoints_;
  torch::Device device_ = torch::kCPU;  ///< that trains
  std::unique_ptr<Algorithm> algorithm_;
  StateDict architecture_;                  // of the checkpoints
  std::unique_ptr<LayoutService> layouts_;  ///< null: the run plays one map
  /// Null where policy workers are processes, or a CPU has its own kernels, or the device has no room.
  std::unique_ptr<policy::SlabFrames> frames_;
  std::unique_ptr<BatchSource> source_;  ///< null: it only serves
  std::unique_ptr<WeightsPublisher> weights_;
  policy::LocalWeights local_weights_;               ///< of the policy threads
  std::unique_ptr<policy::PolicyThreads> policies_;  ///< null: none
  /// Lock step, on-policy: the last boundary, which is saved where the rollout behind it is given up.
  struct Boundary {
    StateDict state;
    PolicyVersion version = 0;
    uint64_t env_frames = 0, decisions = 0;
  };
  std::optional<Boundary> boundary_;
  bool gave_up_ = false;
  double last_poll_s_ = 0;
  uint32_t failed_before_ = 0;  ///< checkpoints that earlier learners of this arena could not write
};

}  // namespace comrad::learn
