// IPPO: every agent learns by PPO as if it were alone. One network is shared by all agents (or each has its
// own, share_parameters off), sees one agent's frames and predicts that agent's own value. The loss is
// on_policy.h's, with A from GAE or V-trace, standardised over the minibatch; one Adam trains everything.
//
// V-trace (with_vtrace) takes ratios and values of the policy in training, anew for every minibatch, caps the
// ratios at vtrace_rho and vtrace_c, and bootstraps behind the rollout and at time-outs from the values
// stored there; an invalid step cuts the trace and counts as its own value. Source: de Witt et al. 2020,
// arXiv:2011.09533; Espeholt et al. 2018, arXiv:1802.01561.
#pragma once

#include "learner/algorithms/on_policy.h"

namespace comrad::learn {

class Ippo : public OnPolicy {
 public:
  Ippo(const RunConfig& config, const EnvShape& env, torch::Device device);

  Expected<UpdateStats> update(RolloutBatch& batch, const UpdateContext& context) override;

  /// Adds the gradient of the loss over a whole minibatch to the parameters' .grad. Makes
  /// `minibatch.advantage` (and under V-trace `target`) what the loss reads. False once keep_going() returned false.
  bool accumulate_gradient(RolloutBatch& minibatch, const UpdateContext& context, TermValues& terms);

  /// Advantages and targets by V-trace with the network as it is now.
  void prepare_vtrace(RolloutBatch& minibatch);

 private:
  Phase phase();
};

}  // namespace comrad::learn
