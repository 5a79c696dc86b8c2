// A run that other hosts may join or watch: what is checked before it starts, and its join endpoint. Stage: before a run.
#pragma once

#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Completes the settings of a run that serves or publishes, and refuses what cannot be served, before anything is written:
/// the interface of the link becomes one that is there. Nothing happens for other runs.
/// Errors: kBadInput (interface, ports, a network without keys), kUnsupported (a scenario by its path).
Status prepare_serving(RunConfig& config, const std::string& key_folder);

/// Writes into the run's folder the link's id and address, and, of a run that serves, the offer. Returns the address for
/// `comrad join` and `comrad top --remote`. Errors: those of make_offer(), keep_link_id(), address_of_interface().
Expected<std::string> open_join_endpoint(const std::string& run_dir, const RunConfig& config,
                                         const std::string& iwad);

/// Starts the simulators of a run with --link dds: a run in its folder that joins it.
HostStart own_simulators(const RunConfig& config, const std::string& run_dir, const std::string& program);

/// The message about how other hosts join.
std::string join_note(const std::string& address, const RunConfig& config);

}  // namespace comrad::deploy
