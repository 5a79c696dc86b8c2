// Runs of a sweep on this machine, at most so many at once, each on its own cores.
#pragma once

#include <string>
#include <vector>

#include "deploy/sweep/sweep_folder.h"
#include "deploy/sweep/sweep_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// A place for one run: the cores and GPUs that no other run of the sweep uses.
struct LocalSlot {
  std::vector<int> cpus;
  std::string gpus;  ///< CUDA_VISIBLE_DEVICES; empty where runs have none
};

/// The slots of a sweep that has `run_count` runs to make. `cpus` are those of the mask, `usable_cores` what the control
/// groups leave of them, `gpus` the machine's. Pure.
/// Errors: kBadInput where cores, GPUs or the sum of memory do not suffice, with what to change.
Expected<std::vector<LocalSlot>> local_slots(const SweepPlan& plan, std::size_t run_count,
                                             const std::vector<int>& cpus, int usable_cores,
                                             int64_t free_memory_bytes, const std::vector<std::string>& gpus);

/// The GPUs that this process may use: CUDA_VISIBLE_DEVICES, else those of /dev.
std::vector<std::string> visible_gpus();

/// Runs what is to do, then the report, and prints how every run ended. SIGINT and SIGTERM: the runs save and stop. A run
/// that another process still has (a killed sweep's, which is saving) is waited for. `program` makes an attempt
/// (`<program> sweep element ...`). The exit code: 0 all finished or stopped, 1 some failed.
/// Errors: those of local_slots; kSystem.
Expected<int> run_local(const SweepPlan& plan, const SweepFolder& folder, const std::string& program);

}  // namespace comrad::deploy
