// Evaluations beside a run that trains. The learner saves a checkpoint whenever another eval_every_env_frames are
// passed; `comrad eval --background` plays it, in its own processes and shared memory, while the run continues:
//
//   learner ── a line of checkpoint/evaluations.jsonl, then the .pt that it names ──▶ Evaluator
//   Evaluator ── the .pt ──▶ comrad eval ── one JSON object ──▶ Evaluator
//   Evaluator ── eval/J ... ──▶ metrics.jsonl and eval/events.out.tfevents.*; the checkpoint is deleted
//
// Requests whose checkpoint exists wait: what a killed run had not played lies there when it is resumed, and what is in
// metrics.jsonl is not played again. Stage: beside the flow of frames.
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
    std::unique_ptr<Process> process;
    double began_s = 0;
    std::string last_line;
  };
  void look(std::vector<std::string>& words);
  Status start(const Snapshot& snapshot);
  std::string finish(const ExitStatus& how);
  Expected<std::string> record();
  int64_t point_of(uint64_t env_frames) const;

  const LaunchPlan& plan_;
  const Clock& clock_;
  ProcessHost& processes_;
  EvaluationFolder& folder_;
  const bool is_wanted_;
  std::set<int64_t> done_;         ///< points: multiples of eval_every_env_frames
  std::vector<Snapshot> waiting_;  ///< oldest first
  std::optional<Playing> current_;
  std::string last_text_;
  double next_look_s_ = 0;
  double kill_at_s_ = 0;
  bool is_stopped_ = false;
};

}  // namespace comrad::deploy
