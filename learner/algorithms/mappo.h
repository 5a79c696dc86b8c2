// MAPPO: IPPO's loss with a central critic. One network is shared by all agents; the values of the N agents
// of a world at one time step come from the core features f_1 .. f_N of all of them, so that each agent's
// baseline sees what its partners see. The value's gradient reaches encoder and core.
//
//   V_i = MLP([f_i, mean of f_j over j != i])      1024 -> 512 -> 256 -> 1    (mappo_critic_view own_first)
//   V   = MLP([f_1 .. f_N])                        512N -> 512 -> 256 -> N    (position, as published)
//
// with tanh behind the hidden layers. By position the outputs are tied to the agents' order although a shared
// actor cannot know it: the same two observations in another order have other values. own_first has one
// function for all agents, exchanges values with agents and does not grow with N; where agents differ,
// agent_id_input marks the agent in both halves of its input.
//
// The rows of a batch stand world by world (RolloutBatch: row = world * N + agent), in the learner as in the
// policy workers; policy::ActorCritic does the grouping. Source: Yu et al. 2022, arXiv:2103.01955; training
// spec 1.5, 2.2.
#pragma once

#include "learner/algorithms/ippo.h"

namespace comrad::learn {

/// `config.run.algo` must be "mappo": it gives the network its central critic.
class Mappo final : public Ippo {
 public:
  using Ippo::Ippo;
};

}  // namespace comrad::learn
