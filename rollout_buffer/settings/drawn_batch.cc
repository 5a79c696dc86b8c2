#include "rollout_buffer/settings/drawn_batch.h"

#include <algorithm>

namespace comrad {

DrawnBatch::Unit counted_unit(const RunConfig& config) {
  if (config.network.use_rnn) return DrawnBatch::Unit::kSequence;
  return config.run.algo->learns_alone() ? DrawnBatch::Unit::kDecisionOfOne
                                         : DrawnBatch::Unit::kJointDecision;
}

DrawnBatch drawn_batch(const RunConfig& config, int64_t num_agents) {
  using Unit = DrawnBatch::Unit;
  const int64_t size = config.q_learning.replay_batch_size;
  // One agent's decision is enough where agents learn alone and by one network without the agent's
  // index.
  if (const Unit unit = counted_unit(config);
      unit != Unit::kDecisionOfOne || (config.network.share_parameters && !config.network.agent_id_input))
    return {unit, size, 1};
  return {Unit::kJointDecision, std::max<int64_t>(1, size / num_agents), num_agents};
}

}  // namespace comrad
