// Logs: one file per process in the run directory's logs/, and stderr for warnings. spdlog lives behind this.
#pragma once

#include <spdlog/spdlog.h>

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// Sends this process's log to `path` (appended; folders are made; what is full moves on to sim-0.1.log, .2, .3, 32 MB in all) and warnings
/// also to stderr. Lines name `role` ("sim-0"), in the file run@host, too: the run is the folder above logs/. Empty path: stderr alone.
/// Errors: kSystem when the file cannot be opened.  Threads: call once, before any other thread logs.
Status init_log(const std::string& role, const std::string& path);

}  // namespace comrad
