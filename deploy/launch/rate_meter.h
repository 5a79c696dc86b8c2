// What a run has done so far: the counters in the arena, the learner's reports, the episodes of an evaluation, and
// the window that a bench measures.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "deploy/launch/gpu_load.h"
#include "deploy/launch/launch_plan.h"
#include "deploy/launch/run_accounts.h"
#include "deploy/launch/run_usage.h"
#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/train_stats.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {

/// The growth of a counter. Where it falls its writer went back to a checkpoint, and counting continues from there.
class Growth {
 public:
  /// Gives by how much the counter fell.
  uint64_t see(uint64_t count) {
    if (count > seen_) total_ += count - seen_;
    return start_from(count);
  }
  /// What the counter grew by until now was no work of this run. Gives by how much it fell.
  uint64_t start_from(uint64_t count) {
    const uint64_t before = std::exchange(seen_, count);
    return before > count ? before - count : 0;
  }
  uint64_t total() const { return total_; }
  /// The counter as it was last seen.
  uint64_t seen() const { return seen_; }

 private:
  uint64_t seen_ = 0;
  uint64_t total_ = 0;
};

/// The counted window of a bench; all 0 for other runs.
struct MeasuredWindow {
  double seconds = 0;
  uint64_t decisions = 0;  ///< agent decisions that the learner trained on (or simulators took) in it
  uint64_t updates = 0;    ///< optimizer steps in it
  std::vector<double> windows = {};     ///< decisions a second of its parts, each from update to update
  RunUsage usage = {};                  ///< in it
  std::optional<double> gpu_busy = {};  ///< share of it; none without a GPU
};

/// Reads the arena, and writes one word into it: the env frames that a learner forgot. Threads: the supervisor's.
class RateMeter {
 public:
  /// The plan outlives the meter.
  explicit RateMeter(const LaunchPlan& plan) : plan_(plan) {}

  /// From now on the counters of `arena` count, which begin at 0; null: there is none. It is not owned.
  void use(const shm::Arena* arena);

  /// Reads the counters. True when the learner was seen to have gone back to a checkpoint.
  bool count();
  /// The learner has ended, is reaped and reclaimed; call before another one starts. Agent decisions lost with it.
  uint64_t learner_ended();
  /// All workers have ended; accounts() is final.
  void close();
  /// Reads the learner's report into last_stats(); false where there is no new one.
  bool take_report();
  /// An episode of an evaluation. A restarted simulator plays some again; they count once.
  void add(const EpisodeRecord& episode);

  /// All workers are there at `now_s`; after everything was restarted, again.
  void begin(double now_s) { running_since_s_ = now_s; }
  /// Opens and closes the bench's window, both at an update; where none comes, it closes after ten times its length. True
  /// once, when it is over.
  bool measure(double now_s);

  /// Agent decisions of this process's life: those trained on, or those played without a learner.
  uint64_t decisions() const {
    return plan_.trains() ? trained_decisions_.total() : played_decisions_.total();
  }
  uint64_t played_decisions() const { return played_decisions_.total(); }
  /// Where they went. Of training, here or for another host's learner.
  DecisionAccounts accounts() const { return accounts_.read(trained_decisions_.total()); }
  /// What does not add up in them; empty while all is well.
  const std::string& account_fault() const { return accounts_.fault(); }
  /// Agent decisions and env frames that the run has learned from, earlier lives included.
  uint64_t decisions_of_run() const;
  uint64_t env_frames() const;
  /// Forgotten by learners that went back to a checkpoint.
  uint64_t env_frames_lost() const { return env_frames_lost_; }
  const TrainStats& last_stats() const { return last_stats_; }
  /// Share of the decisions in the replay that learning waits for; 1: it waits for none.
  double replay_filled() const { return last_stats_.replay_filled; }
  const std::map<uint64_t, EpisodeRecord>& episodes() const { return episodes_; }
  /// NaN before the first episode.
  double episode_score_mean() const;
  const MeasuredWindow& window() const { return window_; }
  /// Mean of the policy lag: over the window, else the learner's last.
  double lag_mean() const;
  double running_since_s() const { return running_since_s_; }  ///< 0: not yet

  /// "learner went back 205k env frames to its last checkpoint"; empty where it did not.
  std::string going_back_text() const;
  /// " (--train_for_...)", the limit that ended the training as the command line spells it: a resumed run may
  /// have nothing left of it. Empty where the learner had another reason.
  std::string limit_reached() const;
  /// What is lost when no further checkpoint is written.
  std::string unsaved_text() const;

 private:
  uint64_t simulators_decisions() const;

  const LaunchPlan& plan_;
  const shm::Arena* arena_ = nullptr;
  Growth trained_decisions_, trained_updates_, played_decisions_;
  RunAccounts accounts_;
  uint32_t learner_epoch_ = 0;
  uint64_t report_sequence_ = 0;  // of the learner's report that was read last
  TrainStats last_stats_;
  int goings_back_ = 0;
  uint64_t env_frames_lost_ = 0;
  std::map<uint64_t, EpisodeRecord> episodes_;
  double running_since_s_ = 0;
  double first_work_s_ = 0;
  double window_began_s_ = 0;
  uint64_t decisions_at_last_look_ = 0;
  uint64_t decisions_before_window_ = 0, updates_before_window_ = 0;
  BenchWindows parts_{1};  // of the window
  RunUsage usage_before_window_;
  std::optional<GpuLoad> gpu_load_;  // of the window
  MeasuredWindow window_;
  double lag_sum_ = 0;
  int lag_count_ = 0;
};

}  // namespace comrad::deploy
