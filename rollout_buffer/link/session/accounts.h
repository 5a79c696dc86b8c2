// What became of what hosts played for a learner, counted on both hosts. Stage: beside the flow.
#pragma once

#include <cstdint>
#include <string>

namespace comrad::link {

/// What came of one host, by the end that serves it.
struct PeerRecord {
  uint64_t peer_id = 0;
  std::string host;
  int workers = 0;
  bool is_here = false;
  uint64_t credits = 0;       ///< slabs that it may send before the learner takes some
  uint64_t decisions = 0;     ///< sealed here
  uint64_t slabs = 0;         ///< sealed here
  uint64_t duplicates = 0;    ///< slabs or requests that had come before
  uint64_t refused = 0;       ///< slabs or batches that no simulator could have made
  uint64_t missing = 0;       ///< rollouts, or batches of frames, that never came
  uint64_t played_there = 0;  ///< decisions, by that host's own word
  uint64_t lost_there = 0;    ///< of them, by its word: sent to this run before it began anew
};

/// What became of this host's decisions, all agents counted: played = delivered + waiting + unfinished + lost, and what
/// simulators that died had in the making.
struct SenderAccount {
  uint64_t played = 0;
  uint64_t delivered = 0;   ///< sealed on the learner's host
  uint64_t waiting = 0;     ///< sealed here, or sent and not yet done
  uint64_t unfinished = 0;  ///< in slabs that are being filled
  uint64_t lost = 0;    ///< sent to a learner's host that began anew: they may have been learned there or not
  uint64_t resent = 0;  ///< slabs, or requests, that were sent once more
};

/// What became of the requests of a host's simulators.
struct FrameAccount {
  uint64_t decisions = 0;  ///< answered, all agents counted
  uint64_t raw_bytes = 0, sent_bytes = 0;
  uint64_t resent = 0;      ///< requests
  uint64_t duplicates = 0;  ///< answers to what was answered, or never asked
  uint64_t refused = 0;     ///< batches of actions that are none
  bool is_compressed = false;
  double latency_us_p50 = 0, latency_us_p90 = 0, latency_us_p99 = 0;  ///< from sending to the answer
};

}  // namespace comrad::link
