// Which checkpoint a run continues from, when one is written, and which score was the best. What lies in them
// is the learner's.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "learner/checkpoint/checkpoint.h"
#include "learner/reports/metrics.h"
#include "learner/reports/run_totals.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// What the learner does for its checkpoints.
struct CheckpointContents {
  std::function<StateDict()> state;
  /// Writes the replay to `file` in `folder` and its name into the state; empty: there is none to write.
  std::function<Status(StateDict& state, const std::string& folder, const std::string& file)> save_replay;
  std::function<void()> was_saved;  ///< a periodic checkpoint
};

/// A count that passes the multiples of a number.
class Milestones {
 public:
  /// `every` 0: none.
  explicit Milestones(double every) : every_(every) {}
  /// What lies at or below `count` is passed.
  void start_from(double count) { last_ = index(count); }
  /// Whether a multiple was passed since the last call.
  bool pass(double count) { return index(count) > std::exchange(last_, std::max(last_, index(count))); }

 private:
  double index(double count) const { return every_ > 0 ? std::floor(count / every_) : 0; }
  double every_;
  double last_ = 0;
};

/// Threads: the learner's.
class CheckpointKeeper {
 public:
  /// What the references name outlives the keeper.
  CheckpointKeeper(const RunConfig& config, const std::string& run_dir, const RunTotals& totals,
                   EpisodeWindow& episodes);
  void write(CheckpointContents contents) { contents_ = std::move(contents); }

  struct Found {
    std::string path;
    StateDict state;
  };
  /// The run's newest checkpoint that can be read (with --load_checkpoint_kind best, the best one first); none in a run
  /// without any. Damaged ones are set aside, unless the learner only serves (`is_reader`).
  /// Errors: kBadFormat when none of several can be read.
  Expected<std::optional<Found>> find(bool is_reader);
  /// The run continues from this checkpoint, which makes `version`. Episodes and the best score are taken over from one
  /// of the same run (`is_own`). Errors: kBadFormat.
  Status resumed_from(const Found& found, PolicyVersion version, bool is_own);
  /// The last episodes and the best score, for the state.
  void append_to(StateDict& state) const;

  /// Writes a periodic checkpoint. Errors: those of CheckpointStore::save and of the replay; they are logged, too.
  Status save(PolicyVersion version);
  /// Does so when save_every_sec are over, or the supervisor's `request` has grown; and writes a best checkpoint when
  /// the mean score of a full window of episodes grew; and those that lie beside them, where it is time: milestones,
  /// which stay, and what the supervisor is requested to evaluate and then deletes (deploy/launch/evaluator.h). A full disk costs
  /// this checkpoint, not the run.
  void save_if_due(PolicyVersion version, uint32_t request);

  /// Whether `version` needs no checkpoint: it lies in one, or none is to be made of it.
  bool is_settled(PolicyVersion version) const { return version == settled_version_; }
  void settle(PolicyVersion version) { settled_version_ = version; }
  /// Path of the newest checkpoint; empty before the first.
  const std::string& last_path() const { return last_path_; }
  const std::string& folder() const { return folder_; }
  /// Periodic checkpoints that could not be written.
  uint32_t failures() const { return failures_; }

 private:
  Status restore_episodes(const Found& found);
  void save_if_best();
  /// Without a replay. What went wrong is logged.
  void save_beside(const std::string& file);
  /// Requests the evaluation of a checkpoint, then writes it.
  void save_to_evaluate(PolicyVersion version);
  /// Removes replays of checkpoints that are no longer kept.
  void prune_replays() const;

  const RunConfig& config_;
  const RunTotals& totals_;
  EpisodeWindow& episodes_;
  const std::string folder_;
  CheckpointStore store_;
  CheckpointContents contents_;
  std::string last_path_;
  PolicyVersion settled_version_ = 0;
  uint32_t request_done_ = 0, failures_ = 0;
  double last_save_s_ = 0, last_best_look_s_ = 0;
  std::optional<double> best_score_;
  Milestones milestone_seconds_, milestone_frames_, evaluation_frames_, video_frames_;
  bool reported_no_best_ = false;
};

}  // namespace comrad::learn
