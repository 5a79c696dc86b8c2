// The runs that a sweep's file requests: the product of its axes without what it excludes, with [search] the trials or members
// of each, each with a name, its settings and a check that `comrad train` would take them. Pure but for `describe`; nothing is written or started here.
#pragma once

#include <string>
#include <vector>

#include "deploy/settings/merged_settings.h"
#include "deploy/settings/start_check.h"
#include "deploy/sweep/sweep_file.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

struct SweepRun {
  std::string name;  ///< for example "lava_pit_ippo_seed42"; its folder below the sweep's
  /// The settings of `comrad train`: shared settings, then the axes; canonical names.
  SettingsLayer settings;
  double goal_env_frames = 0;  ///< train_for_env_frames
  std::string study =
      {};              ///< the search that it belongs to: its axes' values, or the sweep's name; empty: none
  int64_t number = 0;  ///< in the study, from 1
  /// `comrad train` and its flags for this run below `folder`; `comrad` is the program's path. `over`: settings in place of
  /// the run's, or beside them.
  std::vector<std::string> command(const std::string& comrad, const std::string& folder,
                                   const SettingValues& over = {}) const;
};

struct SweepPlan {
  SweepFile file;
  std::string folder;  ///< absolute
  int64_t cores = 1;   ///< of one run
  std::vector<SweepRun> runs;
  /// With [search]: runs that are not made, each with one searched setting at an end of its range or at one of its choices.
  /// `comrad train` would take them, too.
  std::vector<SweepRun> extremes;
};

/// Makes the plan. `host_cores` are shared by local runs where the file names no cores. Every run gets the sizes that
/// follow from its cores (num_workers, learner_threads), so that they do not depend on the host. A run of Q-learning whose
/// replay would take what memory is free at its start gets half of [resources] memory_gb instead (replay_gb), so that the
/// sum over runs is known.
/// Errors: kBadInput as "file:line: what" for settings that cannot be had together, too many runs, none left.
Expected<SweepPlan> plan_sweep(const SweepFile& file, const Describe& describe, int host_cores);

/// `comrad train` would start every run of the plan. Networks that are equal are described once. Errors: kBadInput as
/// "file:line: what"; those of check_start().
Status check_starts(const SweepPlan& plan, const Describe& describe,
                    const DescribeNetwork& describe_network = deploy::describe_network);

/// Runs that exist already can continue with the plan's settings. Errors: kBadInput naming the run and the setting that may
/// not change in it.
Status check_existing_runs(const SweepPlan& plan, const Describe& describe);

/// The name of the run that has these values, one for each axis: scenarios, algorithms and presets as they are, others as
/// <setting><value>, joined by '_'; characters other than letters, digits, '.', '-' and '_' become '-'.
std::string sweep_run_name(const std::vector<SweepAxis>& axes, const std::vector<std::string>& values);

}  // namespace comrad::deploy
