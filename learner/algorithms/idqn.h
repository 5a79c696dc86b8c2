// IDQN: every agent learns the Q-values of its decisions as if it were alone, by one shared network. Each
// action head is its own Q-function that shares the reward:
//
//   y_h   = r + gamma (1 - terminated) Q_target,h(o', argmax_a Q_h(o', a))
//   loss  = w mean_h huber(Q_h(o, a_h) - y_h)
//
// An agent's way ends where it leaves the game, also while the world continues: then y_h is r alone, plus what the
// agent is paid while it is out, discounted (rollout_buffer/replay/post_death_reward.h). Every reward is clipped to
// +-dqn_reward_clip by itself, targets are not. Drawn are single decisions of single agents,
// prioritised by mean_h |TD_h|; with a recurrent core whole sequences. Source: Mnih et al. 2015; Schaul et
// al. 2016, arXiv:1511.05952.
#pragma once

#include "learner/algorithms/q_learning.h"

namespace comrad::learn {

/// `config.run.algo` must be "idqn".
class Idqn final : public QLearning {
 public:
  Idqn(const RunConfig& config, const EnvShape& env, torch::Device device) : QLearning(config, env, device) {}

 protected:
  SampleLoss loss_of(const Scene& scene) const override;
  Tensor sample_valid(const ReplayBatch& batch) const override;
};

}  // namespace comrad::learn
