// What a finished run of a sweep gave, as small text files that can lie in a repository: a clone that has them does not make
// the run again, and `comrad report FOLDER` reads them as it reads runs.
//
//   <folder>/<run>/config.toml      its settings that differ from the built-in ones; where it lay is left out
//   <folder>/<run>/curve.csv         J of training episodes over env frames, at most 60 points
//   <folder>/<run>/result.json      goal, command, commit, machine, date; the evaluation with J and return of every episode; mean
//                                   J of the same episodes played greedily (or drawn, where the evaluation is greedy); what has
//                                   changed since
//   <folder>/random_<scenario>.json  the evaluation of random play
//
// config.toml does not describe a built-in value that no layer of the run sets; a later change of one makes no result stale.
// result.json is written last, so what it names is there. Stage: after a run.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "deploy/sweep/sweep_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

class SweepFolder;

/// result.json, as far as the sweep itself reads it.
struct KeptResult {
  double goal_env_frames = 0;  ///< train_for_env_frames of the run
  double env_frames = 0;       ///< what it trained
  double score = 0;            ///< mean J of the evaluation; NaN where it has none
  std::string stale;           ///< what has changed since; empty: nothing
};

/// Nothing where there is none, or it is damaged.
std::optional<KeptResult> read_result(const SweepResults& results, const std::string& run);

/// Evaluates the finished run and writes its files. `commit` is that of the sources when it was trained, `comrad` is the program's path. Errors: kPeerLost with the evaluation's
/// last words, kNoSpace, kSystem; kBadFormat where the run's own files cannot be read.
Status keep_result(const SweepFolder& folder, const SweepRun& run, const std::string& commit,
                   const std::string& comrad);

/// J over env frames of a metrics.jsonl as CSV with a head: at most `points_max` points, the first and the last among them,
/// evenly spread, J with five digits. Lines without both are left out. Pure.
std::string curve_of(const std::string& metrics, std::size_t points_max);

/// Seconds of training that a metrics.jsonl records, over all starts of the run (status.json counts from the last one); 0
/// where it records none.
double trained_s(const std::string& metrics);

/// The settings that count for what is learned and differ, "learning_rate 4e-04 -> 2e-04, ..."; empty where none does.
/// Where a run lies, what its size follows from and how it is watched do not count. Pure.
std::string recipe_changes(const RunConfig& then, const RunConfig& now);

/// Notes in every kept result of the plan what has changed since it was made: its recipe (the run's settings now),
/// or the map that its settings make now. `map_hash` gives the content hash of the map of a configuration without a pool.
/// Returns how many are stale. Errors: kNoSpace, kSystem.
Expected<int> note_stale_results(
    const SweepPlan& plan, const Describe& describe,
    const std::function<Expected<std::string>(const RunConfig& config)>& map_hash);

}  // namespace comrad::deploy
