// Decides what a run does next: when its workers start again, when it is over, what a pause, a signal or a death means. It
// touches the world through its arguments alone (time, processes, the evaluations' folder, RunEffects), so that the simulation
// in tests/simulation plays the very code that the supervisor runs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "deploy/launch/evaluation_folder.h"
#include "deploy/launch/evaluator.h"
#include "deploy/launch/host_team.h"
#include "deploy/launch/launch_plan.h"
#include "deploy/launch/rate_meter.h"
#include "deploy/launch/run_effects.h"
#include "deploy/launch/run_phase.h"
#include "deploy/launch/worker_table.h"
#include "deploy/process/process_host.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// How a run ended. The exit code and the final state follow from the reason (run_phase.h).
struct RunEnding {
  StopReason reason = StopReason::kNone;
  std::optional<Error> error;  ///< kFailed
  std::string message;         ///< one line
  int restarts = 0;
};

/// Threads: the supervisor's.
class Supervision {
 public:
  /// What the arguments name outlives it.
  Supervision(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes,
              EvaluationFolder& evaluations, RunEffects& effects);

  /// Opens the run and starts its workers; where that fails, the run has failed. Then tick() until has_ended(), then finish().
  void start();
  /// One turn. What the workers have printed, requested and played is taken in before.
  void tick();
  bool has_ended() const { return phase_ == RunPhase::kEnded; }
  /// Closes the accounts.
  RunEnding finish();

  // What the user requests. Errors: kBadInput, in words, where the run cannot do it now.
  Status pause();
  Status resume();
  /// The request's number: done when `checkpoint_done` of the control block reaches it.
  Expected<uint32_t> ask_for_checkpoint(const std::string& who);
  /// SIGINT, SIGTERM or SIGHUP. The last evaluations are not waited for then; a second SIGINT kills, unless it is
  /// the first one once more (kSameInterruptS).
  void interrupt(int signal);
  void ask_to_stop();  ///< comrad ctl
  void input_ended();  ///< the run that called this host has let it go

  /// The run cannot continue.
  void fail(Error error);

  RunPhase phase() const { return phase_; }
  StopReason reason() const { return reason_; }
  /// Why it stops, in words; empty before.
  const std::string& stop_words() const { return stop_words_; }
  double stopping_since_s() const { return stopping_since_s_; }  ///< 0: it does not
  int restarts() const;
  RateMeter& meter() { return meter_; }
  const RateMeter& meter() const { return meter_; }
  WorkerTable& workers() { return workers_; }
  const WorkerTable& workers() const { return workers_; }
  const Evaluator& evaluator() const { return evaluator_; }

 private:
  // Parts of a turn.
  void restart_due();
  void begin_when_all_joined();
  void complete_when_done();
  void tend_evaluations_and_hosts();
  bool saves_something(const Worker& worker) const;
  void enforce_stop();
  void end_when_all_left();

  // Events.
  void exited(Worker& worker, const ExitStatus& how);
  void learner_left();
  void died(Worker& worker, const ExitStatus& how, const std::string& said);
  uint64_t reclaim(Worker& worker);
  void restart_everything();
  void stop(StopReason reason, const std::string& words);
  void leave_out_evaluations();

  Status open();
  void count_work();
  bool is_at_work() const { return phase_ == RunPhase::kRunning || phase_ == RunPhase::kPaused; }
  Status check_at_work(RunEvent event) const;
  void move(RunEvent event);

  const LaunchPlan& plan_;
  const Clock& clock_;
  RunEffects& effects_;
  RateMeter meter_;
  WorkerTable workers_;
  Evaluator evaluator_;
  HostTeam hosts_;
  RunPhase phase_ = RunPhase::kStarting;
  StopReason reason_ = StopReason::kNone;
  std::string stop_words_;
  std::optional<Error> error_;
  double stopping_since_s_ = 0;
  bool starts_again_ = false;         ///< all workers, at the end of this turn's deaths
  bool pauses_when_it_runs_ = false;  ///< all workers start again while it was paused
  int interrupts_ = 0;
  double interrupted_s_ = 0;  ///< when the last of them came
  uint64_t memory_kills_;
};

}  // namespace comrad::deploy
