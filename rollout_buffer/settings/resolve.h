// The last step of merging: "auto" becomes a number, and what cannot be had together is refused. Stage: before a run.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// Replaces the zeros that mean "auto" by numbers for a host of `core_count` cores and checks every range and
/// combination (batch_size is rounded down to a multiple of rollout * num_agents).
/// Errors: kBadInput naming the setting, its value and what it may be; `config` stays as it was then.
Status resolve_settings(RunConfig& config, int core_count);

/// Where policy worker `worker` runs its network: those named by policy_device in turn, or the device of all.
std::string policy_device(const RunConfig& config, int worker);

}  // namespace comrad
