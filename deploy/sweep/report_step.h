// What a sweep does when all its runs have ended: the command that its file names, run by a shell in the sweep's folder.
#pragma once

#include <string>

#include "deploy/sweep/sweep_folder.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// The lines of a shell script that run `command`: `comrad` is found first, "{folder}" stands for the sweep's folder.
std::string report_lines(const SweepFolder& folder, const std::string& command);

/// Runs it; its output goes to records/report.log. Nothing for an empty command. Errors: kPeerLost where it fails, with its
/// last words; kSystem.
Status run_report(const SweepFolder& folder, const std::string& command);

}  // namespace comrad::deploy
