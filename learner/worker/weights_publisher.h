// New weights on their way from the network to their publication, without blocking the learner on its device: a copy is
// taken on the device, goes to the host beside the next step, and is published once it is there. Stage: publish.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>

#include "learner/algorithms/algorithm.h"
#include "policy_workers/device/snapshot.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

/// One copy is on its way at a time, and `interval_s` passes from one to the next; of versions that come meanwhile the newest is
/// next. On a CPU offer() publishes at once where it may. Threads: the one that trains.
class WeightsPublisher {
 public:
  using Publish = std::function<void(std::span<const std::byte> weights, PolicyVersion version)>;
  /// `algorithm` outlives it.
  WeightsPublisher(const Algorithm& algorithm, Publish publish, double interval_s = 0);

  /// The algorithm has new weights.
  void offer();
  /// Publishes what has arrived; between two steps, or within one as long as no weight has changed.
  void deliver();
  /// Publishes what was offered last now, waiting for it.
  void finish();

 private:
  void publish_what_is_there(bool at_once);

  const Algorithm& algorithm_;
  const Publish publish_;
  const double interval_s_;
  double next_s_ = 0;  ///< when the next copy may be taken
  device::Snapshot snapshot_;
  std::optional<PolicyVersion> on_its_way_;
  bool is_newer_offered_ = false;
};

}  // namespace comrad::learn
