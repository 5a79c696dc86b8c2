// One attempt of one run: `comrad train` is started in the sweep's folder, what it prints is kept, and the record states how
// it ended. Both backends start this program for every run, the local one as its child and Slurm as an element of its array.
#pragma once

#include <string>
#include <vector>

#include "deploy/process/child_process.h"
#include "deploy/sweep/sweep_folder.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

struct ElementOptions {
  std::vector<int> cpus;  ///< the attempt is pinned to these; none: anywhere
  bool takes_turns =
      false;  ///< a member of a population ends after one generation; else it continues to its goal
  std::string train_program;  ///< empty: `comrad` beside this program
};

/// Makes the attempt, of a search's run step after step (search_program.h). SIGTERM and SIGINT are passed on: the run saves and may continue later. SIGUSR1, which Slurm sends
/// before the time limit, does the same and then requeues this element in Slurm; so does a run that was killed
/// after it had got further than where it began. The exit code: 0 finished or stopped, 1 failed.
/// Errors: kSystem, kNoSpace (the record).
Expected<int> run_element(const SweepFolder& folder, const SweepRun& run, const ElementOptions& options);

/// What an ended `comrad train` means. `killed_may_go_on`: with Slurm, where a killed attempt that got somewhere is made
/// again.
///
///   was_stopped      we requested its stop
///   status_state  of status.json
///   frames        env frames that it stands at
RunRecord judge_attempt(RunRecord record, const ExitStatus& how, bool was_stopped,
                        const std::string& status_state, double frames, const std::string& last_error,
                        bool killed_may_go_on);

/// The line to quote among what a failed program printed: the last one with "error: " in it, from there; else the last.
std::string quoted_error(const std::vector<std::string>& lines);

}  // namespace comrad::deploy
