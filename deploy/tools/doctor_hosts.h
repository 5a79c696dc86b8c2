// `comrad doctor --hosts`: measures the connection between hosts of a run, and states what to change. Stage: before a run.
#pragma once

#include <string>
#include <vector>

#include "deploy/tools/machine_check.h"
#include "rollout_buffer/link/join/link_check.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// What was measured of the connection from a host to the learner's host, as lines of `comrad doctor`: latency, both directions,
/// clocks.
std::vector<CheckResult> judge_link(const link::LinkReport& link);

/// `where` is the address of a run that serves, its folder, or - for an address on the standard input: the connection from here to
/// that run is measured. Else names of hosts: a join endpoint is opened here, and they are called through ssh to measure the connection to it.
std::vector<CheckResult> check_hosts(const std::string& where, const RunConfig& config);

}  // namespace comrad::deploy
