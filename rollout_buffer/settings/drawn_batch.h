// What one update of Q-learning draws from the replay, by the settings: sequences where the network has a recurrent core,
// else decisions, of one agent where that is enough. Stage: before a run, and sample.
#pragma once

#include <cstdint>

#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// A batch of `units` drawn by chance, each for itself.
struct DrawnBatch {
  enum class Unit { kSequence, kJointDecision, kDecisionOfOne };
  Unit unit;
  int64_t units;
  int64_t setting_value_per_unit;  ///< what a unit counts in replay_batch_size
};

/// What replay_batch_size counts.
DrawnBatch::Unit counted_unit(const RunConfig& config);

/// `config` must be resolved.
DrawnBatch drawn_batch(const RunConfig& config, int64_t num_agents);

}  // namespace comrad
