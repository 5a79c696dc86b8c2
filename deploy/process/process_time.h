// Processor time of processes, from /proc. Serves the supervisor's reports and the benches.
#pragma once

#include <sys/types.h>

#include <string_view>

namespace comrad::deploy {

/// Processor seconds of a process and of its children that have ended, by the text of /proc/<pid>/stat; 0 where it cannot be read.
double process_seconds(std::string_view proc_pid_stat);

/// Those of a process and of all that it started and that still run, as several learners do; 0 for one that is not there.
double family_seconds(pid_t pid);

}  // namespace comrad::deploy
