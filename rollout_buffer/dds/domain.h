// Cyclone's domain in this process, tied to the interface that its configuration names.
#pragma once

#include <dds/dds.h>

#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus_config.h"

namespace comrad::dds {

/// kTimeout where readers do not keep up, else kSystem with Cyclone's return code and what to check.
Error dds_error(dds_return_t code, const std::string& what, const BusConfig& config);

/// A process has one domain object per domain id, made with the configuration that came first; participants of the same
/// run share it, and the last one to leave deletes it and with it Cyclone's threads and sockets.
/// Errors: kBadInput where another run uses the domain in this process; those of make_cyclone_config() and dds_error().
Status enter_domain(const BusConfig& config);
void leave_domain(uint32_t domain_id);

}  // namespace comrad::dds
