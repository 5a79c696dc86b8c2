// What lies between a host and a run's join endpoint, measured through it: the time of an answer, how much goes each
// way, how far the clocks are apart. Stage: before a run.
#pragma once

#include <cstdint>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/join/endpoint.h"

namespace comrad::link {

struct LinkReport {
  double round_trip_ms_min = 0;
  double round_trip_ms_median = 0;
  double round_trip_ms_max = 0;
  double down_bytes_per_s = 0;  ///< from the learner's host, as weights travel
  double up_bytes_per_s = 0;    ///< to it, as trajectories travel
  double clock_ahead_ms = 0;    ///< of this host's clock before the other's, +- half a round trip
};

/// Takes about three seconds, and the way for itself meanwhile. Errors: those of JoinClient; kTimeout where what is sent
/// is not taken.
Expected<LinkReport> check_link(dds::LinkBus& bus, JoinClient& endpoint);

}  // namespace comrad::link
