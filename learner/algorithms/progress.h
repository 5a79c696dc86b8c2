// How far an algorithm's training is, and whose checkpoint that is. Stage: checkpoint.
#pragma once

#include <cstdint>
#include <string>

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

/// Counts of one algorithm, the section "algorithm" of its checkpoints.
struct Progress {
  PolicyVersion version = 0;  ///< optimizer steps taken
  int64_t updates = 0;        ///< batches seen; keys the shuffling

  void save(StateDict& state, const std::string& algorithm) const;
  /// Errors: kBadFormat when another algorithm made `state`.
  static Expected<Progress> load(const StateDict& state, const std::string& algorithm);
};

}  // namespace comrad::learn
