// The shell around the three worker programs (simulator, policy worker, learner): the flags that all of them
// have, signals, the log, how a run is joined, what an error means for the exit code. What a worker does is the
// job that its main() hands over.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/flags.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::shm {

/// Which program this is.
struct WorkerProgram {
  std::string name;  ///< "comrad-sim-worker"
  std::string role;  ///< "sim", "policy", "learner", ...: how it joins; its log is logs/<role>-<index>.log
  std::string description;  ///< for --help
  bool is_single = false;   ///< a run has one of it, so it has no --worker_index
  bool describes = false;   ///< it has --describe
  bool has_bench = true;    ///< it has --bench
};

/// What main() requires done, with the settings of <run_dir>/config.toml.
struct WorkerJobs {
  std::function<Status(const RunConfig& config)> work;  ///< --arena: as a member of a run
  std::function<Status(const RunConfig& config, double seconds)> bench = {};  ///< --bench: alone
  std::function<Status(const RunConfig& config)> describe = {};               ///< --describe: alone
};

/// The text of a library's exception; where a GPU has no memory left, its first line and the settings to lower.
std::string words_of_failure(std::string_view what);

/// One worker program's way from its command line to its exit code:
///
///   WorkerShell shell({.name = "comrad-learner", .role = "learner", ...});
///   shell.flags().add(...);  // those of this program alone
///   return shell.run(argc, argv, {.work = ..., .bench = ...});
///
/// Make it first in main(), and one only. Threads: main.
class WorkerShell {
 public:
  explicit WorkerShell(WorkerProgram program);
  WorkerShell(const WorkerShell&) = delete;
  WorkerShell& operator=(const WorkerShell&) = delete;

  Flags& flags() { return flags_; }

  /// Reads the command line, opens the log, does one of the jobs. Gives the exit code of core/process.h; 2 for a
  /// command line that cannot be read. Errors, exceptions included, go to the log and to standard error.
  ///
  /// In a run SIGTERM raises stop(), SIGINT is the supervisor's to answer, and the process ends with its parent. A bench
  /// or a description is left to the signals' defaults.
  int run(int argc, char** argv, const WorkerJobs& jobs);

  // While a job is done.
  const std::string& run_dir() const { return run_dir_; }
  int worker_index() const { return worker_index_; }
  /// Raised by SIGTERM.
  const std::atomic<bool>& stop() const;
  /// Joins the run that --arena names. Errors: those of join_arena.
  Expected<Arena> join() const;

 private:
  bool is_in_a_run() const { return !is_bench_ && !is_description_; }
  Status do_job(const WorkerJobs& jobs) const;
  int fail(const std::string& message, int code) const;

  WorkerProgram program_;
  Flags flags_;
  std::string run_dir_;
  std::string arena_;
  int worker_index_ = 0;
  double bench_seconds_ = 0;
  std::optional<Flag> arena_flag_, bench_flag_;
  bool is_bench_ = false;
  bool is_description_ = false;
  bool has_log_ = false;
};

/// Flags of a bench or description that has no scenario: the shape of the data.
struct BenchShape {
  int num_agents = 2;
  std::vector<int> heads = {3, 3, 3};
  int measurements = 0, global_state = 0;

  /// Adds --num_agents, --heads, --measurements and --global_state, which this object then holds.
  void add_flags(Flags& flags);
  /// Errors: kBadInput, naming what is out of range.
  Expected<EnvShape> env() const;
};

}  // namespace comrad::shm
