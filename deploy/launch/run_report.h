// How a run reports itself: the progress line, status.json, the last line.
#pragma once

#include <string>

#include "deploy/launch/evaluator.h"
#include "deploy/launch/launch_plan.h"
#include "deploy/launch/rate_meter.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/clock.h"

namespace comrad::deploy {

/// Looks at the meter, the workers and the evaluations of one run; all outlive it. Threads: the supervisor's.
class RunReport {
 public:
  RunReport(const LaunchPlan& plan, const Clock& clock, const RateMeter& meter, const WorkerTable& workers,
            const Evaluator& evaluator)
      : plan_(plan), clock_(clock), meter_(meter), workers_(workers), evaluator_(evaluator) {}

  /// "starting: 1/2 simulators, ...".
  std::string starting_line() const { return "starting: " + workers_.joined_text(); }
  /// One line on a run that continues.
  std::string progress_line() const;
  RunStatus status(const std::string& state, const std::string& message) const;
  /// One line on a run that has ended: how, env frames, time, both rates, J, what was lost, checkpoint.
  std::string summary(const std::string& how_it_ended, double worked_s) const;

 private:
  std::string hosts_text() const;
  std::string evaluation_line() const;
  std::string video_text() const;

  const LaunchPlan& plan_;
  const Clock& clock_;
  const RateMeter& meter_;
  const WorkerTable& workers_;
  const Evaluator& evaluator_;
  const double began_s_ = clock_.now_s();
  const double cpu_began_s_ = process_cpu_s();  ///< of the supervisor
};

}  // namespace comrad::deploy
