// The words in which a run is told of: the progress line, status.json, the last line.
#pragma once

#include <string>

#include "deploy/launch/evaluator.h"
#include "deploy/launch/launch_plan.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/run_meter.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/clock.h"

namespace comrad::deploy {

/// Looks at the meter, the workers and the evaluations of one run; all outlive it. Threads: the supervisor's.
class RunReport {
 public:
  RunReport(const LaunchPlan& plan, const RunMeter& meter, const WorkerTable& workers,
            const Evaluator& evaluator)
      : plan_(plan), meter_(meter), workers_(workers), evaluator_(evaluator) {}

  /// "starting: 1/2 simulators, ...".
  std::string starting_line() const { return "starting: " + workers_.joined_text(); }
  /// One line on a run that goes on.
  std::string progress_line() const;
  RunStatus status(const std::string& state, const std::string& message) const;
  /// One line on a run that has ended: how, env frames, time, both rates, J, what was lost, checkpoint.
  std::string summary(const std::string& how_it_ended, double worked_s) const;
  /// " (--train_for_...)", the limit that ended the training as the command line spells it: a resumed run may
  /// have nothing left of it. Empty where the learner had another reason.
  std::string limit_reached() const;

 private:
  std::string hosts_text() const;
  std::string evaluation_line() const;

  const LaunchPlan& plan_;
  const RunMeter& meter_;
  const WorkerTable& workers_;
  const Evaluator& evaluator_;
  const Stopwatch clock_{CLOCK_PROCESS_CPUTIME_ID};  ///< of the supervisor, from the run's start on
};

}  // namespace comrad::deploy
