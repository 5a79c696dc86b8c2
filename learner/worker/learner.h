// The learner process: drains sealed trajectories, updates the algorithm, publishes weights, keeps
// checkpoints and reports. Stage: drain > sample > update > publish. Asynchronous mode takes slabs as they
// come; lock step (deterministic, or async_rl off) waits for one rollout of every environment, trains on it
// in a fixed order and only then lets the next one begin.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/checkpoint/checkpoint.h"
#include "learner/worker/batch_queue.h"
#include "learner/worker/journal_snapshot.h"
#include "learner/worker/layout_service.h"
#include "learner/worker/learning_check.h"
#include "learner/worker/metrics.h"
#include "learner/worker/replay_feed.h"
#include "rollout_buffer/core/config.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

struct LearnerOptions {
  std::string run_dir;
  bool serve = false;  ///< publish a checkpoint and idle, instead of training
  std::string
      checkpoint;  ///< serve: the file; train: where to begin when the run has no checkpoint of its own
};

/// The device that `name` (auto, cpu, cuda, cuda:<n>) means here. Errors: kUnsupported when there is no such
/// device.
Expected<torch::Device> choose_device(const std::string& name);

/// One learner. Made by start(), which leaves weights published and simulators allowed to begin.
class Learner {
 public:
  /// Opens everything in the order that others depend on: algorithm, checkpoint, weights, journals,
  /// permission. `stop` is raised by a signal handler. Errors: kBadInput (settings, arena of another shape),
  /// kBadFormat (checkpoint), kSystem.
  static Expected<std::unique_ptr<Learner>> start(const LearnerOptions& options, const RunConfig& config,
                                                  shm::Arena arena, std::optional<dds::Bus> bus,
                                                  const std::atomic<bool>& stop);

  /// Trains (or serves) until the run's end or a stop; saves the last checkpoint.
  /// Errors: kBadInput when training diverged, kNotSaved when the last checkpoint could not be written.
  Status run();

  uint64_t env_frames() const { return env_frames_; }
  const Algorithm& algorithm() const { return *algorithm_; }

 private:
  Learner(const LearnerOptions& options, const RunConfig& config, shm::Arena arena,
          std::optional<dds::Bus> bus, const std::atomic<bool>& stop);

  // Start.
  Status check_arena() const;
  Status resume();
  /// `is_own`: a checkpoint of this run, rather than one of another's to begin from.
  Status load(const std::string& path, bool is_own = true);
  /// The window of the last episodes, and the best score that a full one had.
  Status load_episodes(const StateDict& state, const std::string& path, bool is_own);

  // The ways to collect.
  Status run_asynchronous();
  Status run_replay();
  Status run_lock_step();
  Status serve();
  /// Slab indices of rollout `rollout`, one per environment in order; empty when a stop came first.
  Expected<std::vector<uint32_t>> collect_rollout(uint64_t rollout);

  /// Trains on one rollout's slabs, at once or by way of the replay. False when a stop came first.
  Expected<bool> train_rollout(const std::vector<uint32_t>& slabs);
  Expected<bool> replay_rollout(const std::vector<uint32_t>& slabs);

  // What all do.
  UpdateContext update_context();
  Status train(Minibatch& batch);
  Status train(ReplayBatch& batch);
  /// Counts and observes what came into the replay.
  void take_inserted();
  void count(int64_t transitions);
  void publish();
  bool is_finished() const;
  bool stop_requested();
  double seconds_since_stop() const;
  bool wait_while_paused();

  // Checkpoints.
  StateDict state() const;
  Status save_replay(StateDict& state);
  /// Removes replays of checkpoints that are no longer kept.
  void prune_replays() const;
  Status save_checkpoint();
  Status save_if_due();
  /// Saves a best checkpoint when the mean score of a full window of episodes grew.
  void save_if_best();

  // Reports.
  void poll();
  void publish_stats();
  void report_metrics();
  void append_replay(MetricValues& values) const;
  void warn(const std::vector<std::string>& findings);
  void set_state(const char* state);

  LearnerOptions options_;
  RunConfig config_;
  shm::Arena arena_;
  std::optional<dds::Bus> bus_;
  const std::atomic<bool>& stop_;
  std::unique_ptr<Algorithm> algorithm_;
  OnPolicyAlgorithm* on_policy_ = nullptr;    ///< algorithm_, if it is one
  OffPolicyAlgorithm* off_policy_ = nullptr;  ///< the same
  CheckpointStore store_;
  std::optional<MetricsWriter> metrics_;
  std::unique_ptr<BatchQueue> queue_;       ///< on-policy, asynchronous mode
  std::unique_ptr<ReplayFeed> feed_;        ///< off-policy
  std::vector<Minibatch> batches_;          ///< on-policy, lock step: a full one, and one for a shorter rest
  std::unique_ptr<LayoutService> layouts_;  ///< null: the run plays one map
  std::vector<std::byte> weights_;

  // Counted over the whole run, kept in checkpoints.
  uint64_t env_frames_ = 0;
  uint64_t decisions_ = 0;
  double train_seconds_before_ = 0;
  uint64_t next_rollout_ = 0;                ///< lock step
  std::optional<JournalSnapshot> journals_;  ///< of the last boundary, deterministic mode
  double best_score_ = 0;
  bool has_best_ = false;
  bool told_of_no_best_ = false;

  // Of this process.
  double started_s_ = 0;
  double stop_seen_s_ = 0;
  uint32_t checkpoint_seq_done_ = 0;
  PolicyVersion saved_version_ = 0;
  bool lock_step_ = false;
  double last_save_s_ = 0, last_best_look_s_ = 0, last_stats_s_ = 0, last_report_s_ = 0, last_poll_s_ = 0;
  double last_sampled_s_ = 0;
  uint64_t last_sampled_decisions_ = 0;
  uint64_t skipped_steps_ = 0;
  uint64_t broken_decisions_ = 0;
  RateWindow rates_;
  EpisodeWindow episodes_;
  LearningCheck check_;
  std::string last_warning_;  ///< goes into the worker status
  UpdateStats last_update_;
  LagStats last_lag_;  ///< of the newest data
  std::string state_name_ = "starting";
  std::string last_checkpoint_;
};

}  // namespace comrad::learn
