// The way of an off-policy run's data: sealed slabs go into the replay, batches come out of it.
// Asynchronously a feeding and a sampling thread do both while the learner trains; in lock step the learner
// does it itself, one thing after the other. Stage: drain > store > sample.
//
// Several learners have a replay each, of the trajectories of some of the environments, and one pace: when an update is
// due follows from what came in and what was drawn in all of them. A learner reports to the others what came in when it takes
// it (take_inserted), so all count the same, and draw the next batch after the same insert.
//
//   slabs of its environments -> replay -> its part of a batch ─┐
//                        └ count ─ added up over the ranks ──> pace
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "learner/batch/replay_batch.h"
#include "learner/checkpoint/checkpoint.h"
#include "learner/ranks/rank_group.h"
#include "learner/schedules/linear_schedule.h"
#include "rollout_buffer/replay/rate_limiter.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

/// What came in since the last look. Counts and lag are of all learners, tensors are this one's.
struct Inserted {
  int64_t transitions = 0;  ///< agent decisions
  Tensor frame;         ///< u8  [B, C, H, W] what was decided on, for the input statistics; may be undefined
  Tensor measurement;   ///< f32 [B, M]; undefined when M = 0
  Tensor global_state;  ///< f32 [B / N, S]; undefined when S = 0
  LagStats lag;         ///< learner's version minus the one that acted, when it came in
};

/// What the replays of all learners hold together.
struct ReplayContents {
  int64_t units = 0, transitions = 0, capacity_transitions = 0;
  int64_t used_bytes = 0, capacity_bytes = 0;
  int64_t broken_decisions = 0;  ///< found so far
};

class ReplayFeed {
 public:
  /// Creates the replay that the settings describe (replay_plan.h) and logs how much it holds.
  /// `run_dir`: where its file is made if memory is too small. Errors: kBadInput, kNoSpace of the replay (naming
  /// the flags). `device` trains: frames are decoded into memory that it copies by itself. `ranks`: the learners, which
  /// make theirs together, each its part; null: one. Outlives the feed.
  static Expected<std::unique_ptr<ReplayFeed>> create(const RunConfig& config, const TrajectoryShape& shape,
                                                      int64_t weights_bytes, const std::string& run_dir = "",
                                                      torch::Device device = torch::kCPU,
                                                      RankGroup* ranks = nullptr);
  ~ReplayFeed();

  /// Stores a slab. The rate at which samples may be drawn follows.
  void insert(const SlabView& slab, uint32_t length, PolicyVersion learner_version,
              const replay::SlabOrigin& origin = {});
  void insert(const shm::Arena& arena, uint32_t slab, PolicyVersion learner_version);
  /// All learners take at once, and know of each other's from then on.
  Inserted take_inserted();
  /// Env frames counted so far; places the importance weights' exponent and n_step.
  void set_env_frames(double env_frames) { env_frames_ = env_frames; }
  /// The importance weights' exponent now: in a line from per_beta_start to 1, see LinearSchedule.
  double beta() const { return beta_.at(env_frames_); }

  /// Before the first slab: learners that do not all have the replay of their checkpoint count from 0 together.
  void agree_on_pace();

  // Lock step.
  bool is_update_due() const;
  std::unique_ptr<ReplayBatch> sample();

  // Asynchronous mode.
  void start(const shm::Arena& arena);
  /// The next batch, or null after `timeout_ms`: nothing drawn yet, or the learner is ahead of
  /// the simulators.
  std::unique_ptr<ReplayBatch> pop(int timeout_ms);
  /// What ended a thread; empty while all is well.
  std::string failure() const;

  /// After the update: new priorities; the batch's memory is used again.
  void finish(std::unique_ptr<ReplayBatch> batch);

  const replay::Replay& replay() const { return *replay_; }
  /// Share of the decisions that training waits for: 1 once they are there.
  double filled() const { return limiter_.filled(); }
  /// Agent decisions that came in and whose updates are still to be made.
  double decisions_pending() const { return limiter_.pending_inserts(); }
  /// Agent decisions that came in for each update, since training began; 0 before the first.
  double decisions_per_update() const {
    return limiter_.inserts_per_sample() * static_cast<double>(samples_per_update_);
  }
  int waiting() const;
  /// Of several learners as they were at the last take_inserted().
  ReplayContents contents() const { return ranks_.is_alone() ? own_contents() : contents_; }

  /// The replay to a file in `folder`, and its name and counters into `state`; the other learners write theirs beside it.
  /// Where one of them is gone, the checkpoint has no replay. Errors: those of Replay::save.
  Status save(StateDict& state, const std::string& folder, const std::string& file);
  /// With save_replay learners meet here before they drain: the first one signals that it is not about to save; the others
  /// save what it requests until then.
  void meet_before_drain();
  /// What belongs into a checkpoint without its replay, too.
  void save_position(StateDict& state) const;
  /// Continues from a checkpoint. Of this run (`is_own`): takes over what save() left. Without a replay this one
  /// stays empty, and training begins again when a few batches are there: the policy is trained already, so its
  /// decisions are not the chance ones that learning_starts_decisions waits for. Before start(). Errors: kBadFormat; in
  /// deterministic runs also those of Replay::load.
  Status load(const StateDict& state, const std::string& folder, bool is_own);

 private:
  ReplayFeed(const RunConfig& config, const ReplayBatchOptions& batch_options,
             std::unique_ptr<replay::Replay> replay, const replay::RateLimiterOptions& rate,
             int64_t samples_per_update, RankGroup* ranks);
  Status begin_without_replay(const StateDict& state, const std::string& reason);
  ReplayContents own_contents() const;
  Inserted take_own();
  void tell_others(Inserted& taken);
  bool can_draw() const { return replay_->unit_count() > 0 && (ranks_.is_alone() || all_can_draw_); }
  int64_t counts_before_insert();
  void feed();
  void draw();
  void run(const char* name, void (ReplayFeed::*work)());
  std::unique_ptr<ReplayBatch> free_batch();
  void fill_next(ReplayBatch& batch);

  const RunConfig config_;
  RankGroup alone_;
  RankGroup& ranks_;
  const ReplayBatchOptions batch_options_;
  const int64_t samples_per_update_;  ///< agent decisions, of all learners
  std::unique_ptr<replay::Replay> replay_;
  replay::RateLimiter limiter_;
  const int64_t min_size_to_sample_;        ///< agent decisions, of a fresh run
  ReplayContents contents_;                 ///< of all learners
  std::atomic<bool> all_can_draw_ = false;  ///< every one of the replays has a unit
  LinearSchedule beta_;
  std::atomic<double> env_frames_ = 0;
  int64_t draws_ = 0;  ///< batches drawn; keys the chance

  const shm::Arena* arena_ = nullptr;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::unique_ptr<ReplayBatch>> full_;
  std::vector<std::unique_ptr<ReplayBatch>> free_;
  std::string failure_;

  // Of take_inserted(), under inserted_mutex_.
  std::mutex inserted_mutex_;
  int64_t inserted_transitions_ = 0;
  std::vector<uint8_t> inserted_frames_;
  std::vector<float> inserted_measurements_, inserted_states_;
  double lag_sum_ = 0;
  LagStats lag_;

  std::atomic<bool> stop_ = false;
  std::thread feed_thread_, sample_thread_;
};

}  // namespace comrad::learn
