// The policy worker's end of the weights: between two batches it looks whether the learner published a newer
// version, in the arena or within its own process, and copies it into the network. Stage: refresh.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "policy_workers/network/actor_critic.h"
#include "policy_workers/weights/local_weights.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// Keeps one network up to date.
class WeightsReceiver {
 public:
  /// `local`: those of a learner whose thread this is, which leave the arena's alone; null: the arena's.
  explicit WeightsReceiver(const shm::Arena& arena, const LocalWeights* local = nullptr)
      : arena_(&arena), local_(local) {}

  /// Whether anything was published.
  bool has_any() const;
  /// Copies newer weights into `policy`. True if it changed; false when there is nothing newer. Never inside
  /// a batch. Errors: kBadFormat when the bytes do not fit the network or their checksum keeps failing; the
  /// network then keeps the weights it had.
  Expected<bool> refresh(const ActorCritic& policy);
  /// The same for readers of the arena that get the bytes otherwise.
  Expected<bool> refresh(const std::function<Status(std::span<const std::byte>)>& read);

  /// Version in the network; nothing before the first refresh.
  std::optional<PolicyVersion> version() const { return version_; }

 private:
  const shm::Arena* arena_;
  const LocalWeights* local_;
  std::optional<PolicyVersion> version_;
  std::vector<std::byte> buffer_;
};

}  // namespace comrad::policy
