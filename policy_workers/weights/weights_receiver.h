// The policy worker's end of the weights: between two batches it looks whether the learner published a newer
// version and copies it into the network. Stage: refresh.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// Keeps one network up to date.
class WeightsReceiver {
 public:
  explicit WeightsReceiver(const shm::Arena& arena) : arena_(&arena) {}

  /// Copies newer weights into `policy`. True if it changed; false when there is nothing newer. Never inside
  /// a batch. Errors: kBadFormat when the bytes do not fit the network or their checksum keeps failing; the
  /// network then keeps the weights it had.
  Expected<bool> refresh(const ActorCritic& policy) {
    return refresh([&policy](std::span<const std::byte> bytes) { return policy.read_weights(bytes); });
  }
  /// The same for readers that get the bytes otherwise.
  Expected<bool> refresh(const std::function<Status(std::span<const std::byte>)>& read);

  /// Version in the network; nothing before the first refresh.
  std::optional<PolicyVersion> version() const { return version_; }

 private:
  const shm::Arena* arena_;
  std::optional<PolicyVersion> version_;
  std::vector<std::byte> buffer_;
};

}  // namespace comrad::policy
