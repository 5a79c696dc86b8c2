// Evaluations and videos beside a run that trains. The learner saves a checkpoint whenever another eval_every_env_frames or
// video_every_env_frames are passed; `comrad eval --background` plays it, in its own processes and shared memory, while the run
// continues: once for the score, once for the video, whichever is due.
//
//   learner ── a line of checkpoint/evaluations.jsonl, then the .pt that it names ──▶ Evaluator
//   Evaluator ── the .pt ──▶ comrad eval ── one JSON object, or a GIF ──▶ Evaluator
//   Evaluator ── eval/J ..., eval/video ──▶ metrics.jsonl, eval/events.out.tfevents.*, videos/; the checkpoint is deleted
//
// Requests whose checkpoint exists wait: what a killed run had not played lies there when it is resumed, and what is in
// metrics.jsonl or in videos/ is not played again. Stage: beside the flow of frames.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "deploy/launch/evaluation_folder.h"
#include "deploy/launch/launch_plan.h"
#include "deploy/process/process_host.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/metrics/metrics_file.h"

namespace comrad::deploy {

/// The numbers of an evaluation as metrics have them, from what `comrad eval --json` printed.
/// Errors: kBadFormat where a number is missing.
Expected<MetricValues> evaluation_metrics(const std::string& json);

/// Whether scores or videos are made beside a run with these settings.
inline bool is_played_beside(const RunSettings& run) {
  return run.eval_every_env_frames > 0 || run.video_every_env_frames > 0;
}

/// The multiples of a number of env frames for which something is played, each once.
class EvaluationPoints {
 public:
  /// `every` 0: none.
  explicit EvaluationPoints(double every) : every_(every) {}
  bool is_due(uint64_t env_frames) const {
    return every_ > 0 && index(env_frames) > 0 && !done_.contains(index(env_frames));
  }
  void add(uint64_t env_frames) { done_.insert(index(env_frames)); }

 private:
  int64_t index(uint64_t env_frames) const {
    return every_ > 0 ? static_cast<int64_t>(static_cast<double>(env_frames) / every_) : 0;
  }
  double every_;
  std::set<int64_t> done_ = {};
};

/// One evaluation at a time, the oldest checkpoint first. Threads: the supervisor's.
class Evaluator {
 public:
  /// More waiting ones than this are not kept: the oldest are dropped, with a message.
  static constexpr std::size_t kMostWaiting = 8;

  /// What the arguments name outlives the evaluator. Nothing is done where the plan evaluates nothing.
  Evaluator(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes, EvaluationFolder& folder);
  Evaluator(const Evaluator&) = delete;
  Evaluator& operator=(const Evaluator&) = delete;
  /// Ends what is being played; its checkpoint stays for the next start.
  ~Evaluator();

  /// One turn of the supervisor's loop. Returns what the user should read.
  std::vector<std::string> tick();
  /// Looks for checkpoints at the next turn.
  void hurry() { next_look_s_ = 0; }
  /// Something is played or waits for it.
  bool is_busy() const { return current_.has_value() || (!is_stopped_ && !waiting_.empty()); }
  /// It is busy and will be until all are played.
  bool plays_on() const { return !is_stopped_ && is_busy(); }
  /// Plays no more; what is being played is given up.
  void stop(int signal);
  /// "eval J 812.3 at 2M"; empty before the first.
  const std::string& last_text() const { return last_text_; }

 private:
  struct Playing {
    Snapshot snapshot;
    bool is_video = false;
    std::unique_ptr<Process> process;
    double began_s = 0;
    std::string last_line;
  };
  void look(std::vector<std::string>& words);
  Status start(const Snapshot& snapshot);
  std::string finish(const ExitStatus& how);
  Expected<std::string> record();
  Expected<std::string> record_video();

  const LaunchPlan& plan_;
  const Clock& clock_;
  ProcessHost& processes_;
  EvaluationFolder& folder_;
  const bool is_wanted_;
  EvaluationPoints scores_, videos_;
  std::vector<Snapshot> waiting_;  ///< oldest first
  std::optional<Playing> current_;
  std::string last_text_;
  double next_look_s_ = 0;
  double kill_at_s_ = 0;
  bool is_stopped_ = false;
};

}  // namespace comrad::deploy
