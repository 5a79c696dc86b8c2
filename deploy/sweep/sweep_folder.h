// What a sweep leaves on the disk, and what can be read off it at any moment, from any host:
//
//   <train_dir>/<name>/
//     sweep.toml             the file, as it was when the sweep was started last
//     sweep.json             its runs with their settings, the resources of one, and for every start: time, backend,
//                            commit, host
//     records/<run>.json     how the run's attempts went; written only by the process that makes the attempt
//     records/<run>.log      what `comrad train` printed in all of them
//     search/                with [search]: the studies of Optuna (search.py), or what members of populations did (population.h)
//     <run>/                 an ordinary run directory
//
// What a finished run gave is kept elsewhere too where the file requests it (sweep_results.h): such a run counts as finished
// in every clone, whether its directory is there or not.
//
// Every file is written beside its place and renamed, so a SIGKILL leaves the old one or the new one. A run's record states
// `running` until its attempt writes how it ended; where the attempt was killed, the process in the record is gone and the
// run counts as interrupted.
#pragma once

#include <sys/types.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "deploy/process/process_start.h"
#include "deploy/sweep/sweep_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

enum class RunState {
  kWaiting,  ///< never started, or its goal has grown since it finished
  kQueued,   ///< with Slurm, which has not started it
  kRunning,
  kInterrupted,  ///< stopped, preempted or killed before its goal; continues from its checkpoint
  kFailed,
  kFinished,
};
const char* word_of(RunState state);

/// records/<run>.json.
struct RunRecord {
  RunState state = RunState::kWaiting;
  int64_t attempts = 0;
  std::string host;
  pid_t pid = 0;                      ///< of the attempt; on `host`
  uint64_t pid_start_tics = 0;        ///< when it started, since pids are used again
  std::string job;                    ///< "123_4" of Slurm, or empty
  std::string commit;                 ///< commit_of_sources() when the attempt began
  double started_s = 0, ended_s = 0;  ///< since 1970
  int exit_code = 0;
  std::string error;           ///< why it failed or was interrupted, one line
  double goal_env_frames = 0;  ///< of this attempt
  double env_frames_at_start = 0;
  // Of a search.
  int64_t trial = -1;               ///< its number in the study
  int64_t steps = 0;                ///< that are over
  SettingValues settings;           ///< that were searched; of a member, in its present generation
  double pruned_at_env_frames = 0;  ///< finished there, because others were better; 0: it was not
};

/// A run as `comrad sweep status` shows it.
struct RunView {
  std::string name;
  std::string study;  ///< that it belongs to; empty: none
  RunRecord record;
  RunState state = RunState::kWaiting;
  double env_frames = 0, goal_env_frames = 0;
  double env_frames_per_s = 0;
  double score_mean = std::nan("");  ///< J
  bool is_kept = false;              ///< its result lies in the folder of results
  std::string stale;                 ///< what has changed since its result was made; empty: nothing
  /// Whether the same sweep command would start it.
  bool is_to_do() const {
    return state == RunState::kWaiting || state == RunState::kInterrupted || state == RunState::kFailed;
  }
};

/// What Slurm has of a sweep's runs, by their names.
struct QueuedElements {
  std::set<std::string> pending_runs = {}, running_runs = {};
  bool is_known = true;  ///< false: Slurm gave no answer, so what the records say counts
};

/// Facts of one start of the sweep.
struct SweepStart {
  std::string time, backend, commit, host, kernel, processor;
  int64_t cores = 0;
  int64_t memory_bytes = 0;
};

/// The commit of the source folder; "-changed" where tracked files differ from it; empty where there are no sources or no git.
std::string commit_of_sources();

/// Reads the machine and the source folder.
SweepStart facts_of_start(const std::string& backend);

class SweepFolder {
 public:
  /// Makes the folder of `plan` or takes an older one, and writes sweep.toml and sweep.json. What fixes a run's network
  /// or data must be what it was: `file_text` is the sweep's file. Errors: kBadInput (other settings, a folder that is no
  /// sweep's), kNoSpace, kSystem.
  static Expected<SweepFolder> make(const SweepPlan& plan, const std::string& file_text,
                                    const SweepStart& start);
  /// The folder that make() would make; nothing is written.
  static SweepFolder planned(const SweepPlan& plan);
  /// The sweep that lies in `path`. Errors: kNotFound, kBadFormat.
  static Expected<SweepFolder> open(const std::string& path);

  const std::string& path() const { return path_; }
  const std::string& name() const { return name_; }
  const std::vector<SweepRun>& runs() const { return runs_; }
  const SweepResults& results() const { return results_; }  ///< its folder is absolute
  const SweepSearch& search() const { return search_; }
  const SweepRun* find(const std::string& run) const;
  std::string run_dir(const SweepRun& run) const { return path_ + "/" + run.name; }
  std::string record_path(const SweepRun& run) const { return path_ + "/records/" + run.name + ".json"; }
  std::string log_path(const SweepRun& run) const { return path_ + "/records/" + run.name + ".log"; }

  /// The record as it stands; nothing where there is none (or it is damaged).
  std::optional<RunRecord> read_record(const SweepRun& run) const;
  Status write_record(const SweepRun& run, const RunRecord& record) const;

  RunView look(const SweepRun& run, const QueuedElements& queued) const;
  std::vector<RunView> look(const QueuedElements& queued) const;

  /// Makes the folder if need be, and keeps other sweeps out of it for as long as the descriptor is open. Errors: kBadInput
  /// with the pid of the one that has it; kSystem.
  static Expected<Descriptor> lock(const std::string& path);
  /// The sweep that holds the lock, on this host; 0 where none does.
  pid_t lock_owner() const;

 private:
  std::string path_, name_;
  std::vector<SweepRun> runs_;
  SweepResults results_;
  SweepSearch search_;
};

/// When the process started, in tics of the system's clock since boot; nothing where there is no such process.
std::optional<uint64_t> start_tics_of(pid_t pid);
std::string host_name();
/// "2026-11-24T03:32:12Z" of seconds since 1970.
std::string utc_text(double seconds);

}  // namespace comrad::deploy
