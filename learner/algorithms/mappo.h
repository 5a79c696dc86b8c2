// MAPPO: IPPO's loss with a central critic. One network is shared by all agents; the values of the N agents
// of a world at one time step come from the concatenation of their N core features, one value per agent, so
// that each agent's baseline knows what its partners see. The value's gradient reaches encoder and core.
//
//   V(o_1..o_N) = W3 tanh(W2 tanh(W1 [f_1 .. f_N] + b1) + b2) + b3        512N -> 512 -> 256 -> N
//
// The rows of a batch stand world by world (Minibatch: row = world * N + agent), in the learner as in the
// policy workers; policy::PolicyNet does the grouping. Source: Yu et al. 2022, arXiv:2103.01955; training
// spec 1.5, 2.2.
#pragma once

#include "learner/algorithms/ippo.h"

namespace comrad::learn {

/// `config.algo` must be "mappo": it gives the network its central critic.
class Mappo final : public Ippo {
 public:
  using Ippo::Ippo;

 protected:
  const char* name() const override { return "mappo"; }
};

}  // namespace comrad::learn
