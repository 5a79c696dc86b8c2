// How `comrad ctl` and `comrad top` find a run that is alive and talk to its supervisor (deploy/launch/control_socket.h).
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/launch/control_socket.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// A run that had a supervisor when it was looked at.
struct LiveRun {
  std::string name;  ///< of its folder
  std::string dir;
  ControlAddress control;
};

/// The run that a user names, by folder or experiment. Errors: kNotFound where there is no such run or it is not running,
/// kBadInput where it runs on another host or has no control socket here, each with what to do.
Expected<LiveRun> find_live_run(const std::string& name, const std::string& train_dir);
/// The runs of a folder whose lock is held, sorted by name.
std::vector<LiveRun> live_runs(const std::string& train_dir);

/// Sends a request and waits for the answer. Errors: what the run said; kPeerLost where it has ended, kTimeout, and kBadInput where
/// it belongs to another user.
Expected<nlohmann::json> ask(const LiveRun& run, const nlohmann::json& request, double timeout_s = 5);

}  // namespace comrad::deploy
