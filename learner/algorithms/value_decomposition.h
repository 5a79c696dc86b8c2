// What VDN, QMIX and QPLEX share: the agents' utilities Q_i(a) = sum_h Q_i,h(a_h) are mixed into one Q_tot,
// which learns from the team's reward:
//
//   y     = R + gamma (1 - terminated) Q_tot,target(s', a*)    a*_i,h = argmax_a Q_i,h(o_i', a)
//   loss  = mean huber(Q_tot(s, a) - y) + regularizer          y within +-q_value_clamp
//
// R is the sum (or mean, team_reward) of the agents' rewards; the state s of the mixer is the N encoders'
// features side by side, recomputed from the stored frames and detached (with mixer_state_deviation each agent's
// normalised), and with critic_state global the world's true state behind them. A world ends for all its agents at
// once; an agent that is out of the game has utility 0.
#pragma once

#include "learner/algorithms/q_learning.h"

namespace comrad::learn {

class ValueDecomposition : public QLearning {
 public:
  ValueDecomposition(const RunConfig& config, const EnvShape& env, torch::Device device)
      : QLearning(config, env, device) {}

 protected:
  SampleLoss loss_of(const Scene& scene) const override;
  Tensor sample_valid(const ReplayBatch& batch) const override;
};

}  // namespace comrad::learn
