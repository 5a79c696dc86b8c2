// Many hosts that send trajectories to one learner's host: both ends of the trajectory link as they are, on small arenas,
// over a simulated network with a line of a given width, in simulated time.
#pragma once

#include <cstdint>

namespace comrad::simulation {

/// What one host costs another; the defaults are measured (deploy/SCALE.md).
struct ManyHosts {
  int hosts = 10;
  double seconds = 60;
  double decisions_per_s = 1500;          ///< that one host plays
  double learner_decisions_per_s = 20e3;  ///< that the learner takes from other hosts
  double leaving_per_minute = 0.1;        ///< share of the hosts that leave, and come back 5 s later
  double line_bytes_per_s = 1.25e9;       ///< of the learner's host, each way
  double slab_bytes = 1.1e6;              ///< of 64 decisions, as it travels
  double weights_bytes = 4e6;
  double cpu_s_per_decision = 0.12e-3;  ///< of the receiver's thread
  double cpu_s_per_message = 8e-6;      ///< of that thread, for each small message to or from one host
  uint64_t seed = 1;
};

struct ManyHostsOutcome {
  double places_s = 0;         ///< until every host had its places; 0: never
  double decisions_per_s = 0;  ///< sealed
  double in_bytes_per_s = 0, out_bytes_per_s = 0;
  double in_messages_per_s = 0, out_messages_per_s = 0;
  double cpu_share = 0;                       ///< of the receiver's thread
  double queue_mb_most = 0;                   ///< of what had arrived and was not taken
  int slabs_reserved_most = 0;                ///< free slabs of the learner's arena that were promised
  double least_share = 0;                     ///< what the host with the fewest decisions got, of the mean
  double back_s_median = 0, back_s_most = 0;  ///< from a host's return until it sends again
  uint64_t lost = 0, duplicates = 0;          ///< trajectories
};

ManyHostsOutcome play(const ManyHosts& hosts);

}  // namespace comrad::simulation
