// A sweep in words: the table of `comrad sweep status`, the one line of a sweep at work, and the same as JSON.
#pragma once

#include <string>
#include <vector>

#include "deploy/sweep/sweep_folder.h"

namespace comrad::deploy {

/// "5 of 12 finished, 2 running, 1 failed | 7.1k env frames/s | ETA 2h10m". The ETA is what is left of all runs at the
/// present rate of those that run; failed ones are not counted in it.
std::string sweep_line(const std::vector<RunView>& views);

/// A line for each run (state, env frames, rate, J, ETA, host, attempts; of a search its settings), the sum, the best run of each
/// search, and why the failed ones failed.
std::string sweep_table(const std::vector<RunView>& views);

/// {"runs": [{"name", "state", "env_frames", ...}], "finished": n, ...}, one line.
std::string sweep_json(const std::string& name, const std::string& folder, const std::vector<RunView>& views);

}  // namespace comrad::deploy
