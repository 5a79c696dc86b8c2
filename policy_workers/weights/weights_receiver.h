// The policy worker's end of the weights: between two batches it looks whether the learner published a newer
// version and copies it into the network. Stage: refresh. The bytes and the version word in the arena are the
// truth; the notice on DDS only tells what to expect.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "policy_workers/policy/policy_net.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// Keeps one network up to date.
class WeightsReceiver {
 public:
  explicit WeightsReceiver(const shm::Arena& arena) : arena_(&arena) {}

  /// Copies newer weights into `policy`. True if it changed; false when there is nothing newer. Never inside
  /// a batch. Errors: kBadFormat when the bytes do not fit the network or their checksum keeps failing; the
  /// network then keeps the weights it had.
  Expected<bool> refresh(const PolicyNet& policy);

  /// A version notice from the bus. Errors: kBadFormat when the learner's network has another size than
  /// `policy`.
  Status hear(const dds::WeightsUpdate& update, const PolicyNet& policy);

  /// Version in the network; nothing before the first refresh.
  std::optional<PolicyVersion> version() const { return version_; }
  /// Newest version that was announced and is not in the network yet, by how many steps.
  uint32_t behind() const;

 private:
  const shm::Arena* arena_;
  std::optional<PolicyVersion> version_;
  PolicyVersion announced_ = 0;
  std::vector<std::byte> buffer_;
};

}  // namespace comrad::policy
