// Runs of a sweep as one Slurm job array. What is pending or running is asked of squeue, by the names that the jobs were
// given; how a run went is in its record and its folder. No accounting database is needed, and nothing stays running
// on the host that submits.
//
//   records/slurm_<n>.sh         the batch script of submission n; element i makes the i-th of its runs
//   records/slurm_<n>.json       {"runs": [names]}, written before sbatch is asked
//   records/slurm_<n>_report.sh  the job that waits for all of them
//   records/slurm_<n>_<i>.log    what Slurm itself and the element print
#pragma once

#include <string>
#include <vector>

#include "deploy/sweep/sweep_folder.h"
#include "deploy/sweep/sweep_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// The name of submission `number`'s array, by which squeue finds it: it names the sweep and differs between folders.
std::string slurm_job_name(const SweepFolder& folder, int number);

/// The batch script that makes `runs`; `program` makes an attempt (`<program> sweep element ...`). Pure.
std::string slurm_script(const SweepPlan& plan, const SweepFolder& folder, int number,
                         const std::vector<std::string>& runs, const std::string& program);

/// The batch script of the report that waits for the array job `array`. Pure.
std::string slurm_report_script(const SweepPlan& plan, const SweepFolder& folder, int number,
                                const std::string& array);

/// The scripts that run_slurm() would submit for all runs, with the name of each; nothing is written or asked.
std::string slurm_dry_run(const SweepPlan& plan, const std::string& program);

/// The runs that are pending or running with Slurm, of all submissions of this folder; none, without asking, where there
/// were no submissions. Errors: kNotFound without squeue; kSystem where it fails, in its words.
Expected<QueuedElements> queued_elements(const SweepFolder& folder);

/// What squeue prints for "--array --format=%j|%K|%T", read with the runs of each job name. Other lines are ignored.
QueuedElements parse_queue(const std::string& text,
                           const std::vector<std::pair<std::string, std::vector<std::string>>>& runs_of_job);

/// Submits what is to do and not with Slurm already, and the report that waits for it. The exit code.
/// Errors: those of queued_elements and sbatch, in its words; kNoSpace.
Expected<int> run_slurm(const SweepPlan& plan, const SweepFolder& folder, const std::string& program);

/// Takes pending elements and reports out of the queue, and signals running ones to save and stop. How many jobs it was.
Expected<int> stop_slurm(const SweepFolder& folder);

}  // namespace comrad::deploy
