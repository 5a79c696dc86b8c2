// The frame link as `comrad bench transport --link dds` measures it: both ends over loopback. A build without hosts has none.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::bench {

struct BenchedLink {
  uint64_t id = 0;
  std::string keys;  ///< folder of keys, or empty
  std::string compression;
};

/// What one end sent; it lies in memory that processes share.
struct SentFrames {
  uint64_t decisions = 0, raw_bytes = 0, sent_bytes = 0, resent = 0;
  bool is_compressed = false;
};

/// Errors: kUnsupported in a build without hosts; those of dds::validate().
Status check_link(const BenchedLink& link);
/// The end on the host with the policy, until its arena's run stops.
void receive(const shm::Arena& arena, const BenchedLink& link);
/// The end on the simulators' host, until its arena's run stops.
SentFrames send(const shm::Arena& arena, const BenchedLink& link);

}  // namespace comrad::bench
