// The workers of a run: their roles, how each is started, what they print, whether they still play.
#pragma once

#include <poll.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/restart_policy.h"
#include "deploy/process/process_host.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::deploy {

enum class Role { kSim, kPolicy, kLearner, kTrajectoryReceiver, kFrameReceiver, kTrajectorySender };
constexpr std::size_t kRoleCount = 6;
/// "simulators", "policy workers", "learner", "trajectory receiver", "frame receiver", "trajectory sender".
const char* name_of(Role role);
/// "sim", "policy", "learner", "receiver", "frame-receiver", "sender": as it joins.
const char* word_of(Role role);

/// One worker's place in the run; the process in it may change.
struct Worker {
  Role role = Role::kSim;
  int index = 0;
  std::string name;  ///< "sim-0", "policy-0", "learner"
  std::unique_ptr<Process> process;
  RestartHistory history;
  bool has_joined = false;
  double started_s = 0;
  double restart_at_s = 0;          ///< 0: no restart is due
  int restarts = 0;                 ///< deaths so far
  bool is_unreclaimed = false;      ///< what the dead one held is still to be taken back
  uint64_t decisions_at_start = 0;  ///< of its counter in the arena
  uint32_t epoch_at_start = 0;      ///< the same: lives of this worker before
  std::string last_line;            ///< of its output
  double minute_began_s = 0;
  int lines_shown = 0;   ///< since then
  int stop_signal = 0;   ///< sent because it did not leave by itself
  double at_work_s = 0;  ///< when it was last seen at work since the stop, if it has something to save
  bool is_slow = false;  ///< the message that its stop takes long was printed
  uint64_t decisions_heard = 0;  ///< of its counter, and when it moved last
  double heard_s = 0;
};

/// All workers of one run, simulators first, the learner and what links hosts last. Threads: the supervisor's.
class WorkerTable {
 public:
  /// The places that `plan` requests, all empty. What the arguments name outlives the table.
  WorkerTable(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes);

  std::vector<Worker>& workers() { return workers_; }
  const std::vector<Worker>& workers() const { return workers_; }

  /// Starts the worker's program, which will join `server`. Errors: those of ProcessHost::spawn.
  Status start(Worker& worker, const shm::Arena& arena, const std::string& server);
  /// Kills and reaps every worker; `restart_at_s` is when they start again.
  void restart_all(double restart_at_s);
  void signal_all(int number);
  /// A worker that has died since it asked has not joined.
  void note_joined(const shm::JoinRequest& request);

  /// CPU seconds of all processes of a role so far, those that have ended included.
  double cpu_seconds(Role role) const;
  bool any_alive() const;
  bool has(Role role) const;
  bool all_joined() const;
  /// "1/2 simulators, 0/1 policy workers, 1/1 learner": how many have joined.
  std::string joined_text() const;

  /// What poll() waits for: the output of every worker.
  void append_outputs(std::vector<pollfd>& sources) const;
  /// Logs what the workers have printed, and shows it: 20 lines a minute of each, and every warning once.
  void read_output(ProgressPrinter& printer);
  /// Takes out the workers that have ended, learner first. One that has not joined in time (LaunchPlan::join_timeout_s) is
  /// killed, unless the run `is_stopping`.
  std::vector<std::pair<Worker*, ExitStatus>> reap_exited(bool is_stopping);

  /// Checks which workers' counters changed. No worker counts as silent while the run is not `at_work`.
  void listen(const shm::Arena& arena, bool at_work);
  /// "sim-0 silent for 12s (SIGSTOP)"; empty without silent workers. A worker that waits for another is not the cause: a worker is named
  /// where a signal stopped it, or where another of its kind continues.
  std::string silence_text() const;
  /// Whether no simulator has played for so long that the last rate is no longer true.
  bool stands_still() const;

  /// The worker's last line; where it printed none, that of its log.
  std::string last_words(const Worker& worker) const;
  std::string log_path(const Worker& worker) const;

 private:
  ChildOptions options_of(const Worker& worker, const std::string& server) const;

  /// Lets go of the worker's process, whose CPU time is kept.
  void forget_process(Worker& worker);

  const LaunchPlan& plan_;
  const Clock& clock_;
  ProcessHost& processes_;
  std::vector<Worker> workers_;
  std::array<double, kRoleCount> cpu_s_of_ended_{};
  std::set<std::string> words_shown_;  // without their numbers
};

/// The worker's counters in the arena.
shm::WorkerCounters& counters_of(const Worker& worker, const shm::Arena& arena);

/// Whether it has made progress since it was started.
bool has_worked(const Worker& worker, const shm::Arena& arena);

/// Gives back what a dead worker held. Agent decisions that are lost with it; nothing where a policy worker that stands still
/// half way through a batch still writes into its slabs: try again later.
std::optional<uint64_t> reclaim_worker(const Worker& worker, const shm::Arena& arena);

}  // namespace comrad::deploy
