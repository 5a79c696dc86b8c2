// What a run of a search does between its steps of training: search.py (Optuna) chooses and judges trials, population.h members.
#pragma once

#include <string>

#include "deploy/sweep/sweep_folder.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// A Python that has Optuna: $COMRAD_SEARCH_PYTHON, else the environment that ./comrad makes in the build folder, else Debian's
/// or the one of PATH. Errors: kNotFound with what to install.
Expected<std::string> search_python();

/// Makes the folder search/ and the studies that are missing. Errors: kNotFound where the study of a trial that was begun is
/// missing, kBadFormat where one is damaged; those of search_python; kSystem, kNoSpace.
Status begin_search(const SweepFolder& folder);

/// The next settings of `comrad train`, beside or in place of the run's settings.
struct SearchStep {
  SettingValues settings;     ///< train_for_env_frames among them
  double end_env_frames = 0;  ///< where the step ends
};

/// The settings of the run's next step, which the record contains from now on; the caller writes it. A run that is no search's has
/// one step, without settings. Errors: of the study or the population's files, with what to do.
Expected<SearchStep> begin_step(const SweepFolder& folder, const SweepRun& run, RunRecord& record);

/// Whether the run continues after a step that ended; `record` states how many there were, and where it was pruned. `score`: J; NaN
/// where no episode has ended. Errors: as begin_step(); kNotFound for a trial without a score.
Expected<bool> end_step(const SweepFolder& folder, const SweepRun& run, RunRecord& record, double env_frames,
                        double score);

/// A run that failed: its trial counts as failed. Errors: as begin_step().
Status give_up(const SweepFolder& folder, const SweepRun& run, const RunRecord& record);

}  // namespace comrad::deploy
