// Logs: one file per process in the run directory's logs/, and stderr for warnings. spdlog lives behind this.
#pragma once

#include <spdlog/spdlog.h>

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// Sends this process's log to `path` (appended; parent folders are made) and warnings also to stderr, with
/// `role` ("sim-0", "learner") on every line. An empty path logs to stderr alone.
/// Errors: kSystem when the file cannot be opened.  Threads: call once, before any other thread logs.
Status init_log(const std::string& role, const std::string& path);

}  // namespace comrad
