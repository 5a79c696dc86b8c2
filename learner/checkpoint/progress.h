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

  /// `global_state_count`: numbers of the true state that its critic or mixer sees; 0 with critic_state features.
  void save(StateDict& state, const std::string& algorithm, int64_t global_state_count) const;
  /// Errors: kBadFormat when another algorithm made `state`, or one whose critic sees something else.
  static Expected<Progress> load(const StateDict& state, const std::string& algorithm,
                                 int64_t global_state_count);
};

}  // namespace comrad::learn
