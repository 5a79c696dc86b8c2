// Queries the network's size: this program does not load libtorch, comrad-policy-worker does.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/network_size.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// The size of the network that `config` describes, for agents of shape `env`. Takes a second or two.
/// Errors: kBadInput where the network cannot be made (an unknown encoder), in its words; those of run_program(); kSystem
/// where no temporary file can be written.
Expected<NetworkSize> describe_network(const RunConfig& config, const EnvShape& env);

/// The flags that tell a worker program the shape of agents where it has no scenario (shm::BenchShape reads them).
std::vector<std::string> shape_flags(const EnvShape& env);

/// Reads what comrad-policy-worker --describe prints. Errors: kBadFormat.
Expected<NetworkSize> parse_network_size(std::string_view text);

}  // namespace comrad::deploy
