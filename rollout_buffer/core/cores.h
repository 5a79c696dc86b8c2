// Which cores this process may use: what `taskset` or a container left of the machine's. Stage: start-up.
#pragma once

#include <optional>
#include <vector>

#include "rollout_buffer/core/control_group.h"

namespace comrad {

/// On so many and fewer the processes of a run take turns, and defaults make those turns long and few (BENCHMARKS.md).
constexpr int kFewCores = 2;

/// The CPUs of this process's mask (sched_getaffinity), by rising number. Never empty: CPU 0 where the mask cannot be read.
std::vector<int> allowed_cpus();

/// How many cores this process may use: those of its mask, or what the CPU quotas of its control group and of those above it
/// allow where that is less (rounded up, at least 1).
int usable_cores();

/// The tightest quota among control groups of the controller "cpu", in cores; nothing where none is set. Version 2 reads
/// cpu.max, version 1 cpu.cfs_quota_us and cpu.cfs_period_us.
std::optional<double> control_group_cores(const std::vector<ControlGroup>& groups);

}  // namespace comrad
