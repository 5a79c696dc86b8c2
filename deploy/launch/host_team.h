// Hosts that `comrad train` starts for its run: ssh or srun runs `comrad join` there, gets the run's address through its
// standard input, and leaves when that ends. A host that cannot be had or goes away never ends the run. Stage: beside the
// flow of frames.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/restart_policy.h"
#include "deploy/process/process_host.h"
#include "rollout_buffer/core/clock.h"

namespace comrad::deploy {

/// Threads: the supervisor's.
class HostTeam {
 public:
  /// What the arguments name outlives the team.
  HostTeam(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes);

  /// One turn of the supervisor's loop: starts what is due, once the run is at work. Returns what the user should read.
  std::vector<std::string> tick(bool is_running);
  /// No further host is contacted. Hosts leave at the run's end; those that do not are requested to after a while, and dropped.
  void stop();
  bool any_alive() const;
  /// They leave at once.
  void kill();
  /// Why a host that the run needs is not called again; empty while all goes well.
  const std::string& failure() const { return failure_; }

 private:
  struct Host {
    const HostStart* start = nullptr;
    std::unique_ptr<Process> process;  ///< the end of its input requests it to leave
    RestartHistory history;
    double start_at_s = 0;  ///< the next call
    double started_s = 0;
    bool is_given_up = false;
    std::string last_line;
  };
  void call(Host& host, double now_s, std::vector<std::string>& words);
  void look_at(Host& host, double now_s, std::vector<std::string>& words);
  void ended(Host& host, const ExitStatus& how, double now_s, std::vector<std::string>& words);

  const LaunchPlan& plan_;
  const Clock& clock_;
  ProcessHost& processes_;
  std::vector<Host> hosts_;
  double stopping_since_s_ = 0;  ///< 0: not stopping
  std::string failure_;
};

}  // namespace comrad::deploy
