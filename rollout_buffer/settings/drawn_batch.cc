#include "rollout_buffer/settings/drawn_batch.h"

#include <algorithm>

namespace comrad {

DrawnBatch drawn_batch(const RunConfig& config, int64_t num_agents) {
  using Unit = DrawnBatch::Unit;
  const QLearningSettings& q = config.q_learning;
  if (config.network.use_rnn) return {Unit::kSequence, q.qmix_batch_sequences, "qmix_batch_sequences", 1};
  if (!config.run.algo->learns_alone())
    return {Unit::kJointDecision, q.qmix_batch_joint_decisions, "qmix_batch_joint_decisions", 1};
  // One agent's decision is enough where agents learn alone and by one network that does not ask who
  // they are.
  if (config.network.share_parameters && !config.network.agent_id_input)
    return {Unit::kDecisionOfOne, q.dqn_batch_decisions, "dqn_batch_decisions", 1};
  return {Unit::kJointDecision, std::max<int64_t>(1, q.dqn_batch_decisions / num_agents),
          "dqn_batch_decisions", num_agents};
}

}  // namespace comrad
