// What a run that serves offers to hosts that join it, and what a host that joins makes of it: settings, maps and the
// checksums of what must lie on both hosts already. Stage: before a run.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/link/join/endpoint.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// The settings as other hosts play them: without what concerns the serving host alone (its folders, processes, devices,
/// limits), with maps by their names in the offer.
RunConfig offered_settings(const RunConfig& config);

/// The checksum of a scenario's files that are played: rules, scripts, actors. Errors: kNotFound.
Expected<uint64_t> scenario_checksum(const std::string& scenario);

/// Whether policy workers of this host will compute on a GPU. `--device auto` does where there is a driver.
bool computes_on_cuda(const RunConfig& config);

/// Errors: kUnsupported for a scenario that is named by a path.
Status check_can_be_offered(const RunConfig& config);

/// Makes the offer of the run in `run_dir`, whose config and maps lie there, and writes it with the offered settings into
/// that folder. Errors: those of check_can_be_offered(); kNotFound, kSystem.
Status make_offer(const std::string& run_dir, const RunConfig& config, const std::string& iwad);

/// Compares the offer with what lies on this host. Errors: kBadInput saying what differs and what to do.
Status compare_with(const link::Offer& offer, const std::string& iwad);

/// The settings of a run in `run_dir` that joins, from the offered ones that were fetched into that folder. Maps are those
/// that were fetched. Errors: kBadFormat.
Expected<RunConfig> joined_settings(const std::string& run_dir);

}  // namespace comrad::deploy
