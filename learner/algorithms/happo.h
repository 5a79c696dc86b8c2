// HAPPO: the agents of a world improve one after the other, each against what those before it have already
// become. Every agent has its own actor; one critic with an encoder (and core) per agent values the team's
// joint observation.
//
//   M   <- A                           GAE of the joint value, standardised over all agents' acting samples
//   for agent i in random order:       (happo_agent_order)
//     train pi_i by PPO on             - mean min(ratio_i M, clip(ratio_i) M) + exploration
//     M <- M pi_i^new(a_i) / pi_i^old(a_i)                            for all agents of the transition
//   train the critic                   on whole transitions, PPO's clipped value loss
//
// Each training is num_epochs x num_batches_per_epoch steps of an Adam instance.
//
// ratio_i is relative to the behaviour policy as in IPPO, so data of a lagging worker is corrected; the
// factor is relative to the agent's policy before its sub-update. It is 1 where the sample is invalid or the
// agent dead, and clamped to [1/c, c] per agent where happo_factor_clamp = c > 1. A factor outside the min, as
// in the authors' code, gives the same gradient, since it is positive. Every optimizer step is a version of
// one, so a batch makes num_epochs x num_batches_per_epoch x (N + 1) of them; all networks travel together
// under one checksum, so no policy worker acts with half of an update.
//
// One value for all agents presumes a team reward. Where agents of a transition are paid differently the
// critic learns the mean of their returns, and the first such batch is logged; shared_reward_alpha 1 makes
// them equal. Source: Kuba et al. 2022, arXiv:2109.11251, algorithm 4 (HAPPO).
#pragma once

#include <vector>

#include "learner/algorithms/on_policy.h"

namespace comrad::learn {

/// exp(new - old) where valid, else 1; clamped to [1/clamp, clamp] when clamp > 0. Any shape, f32.
Tensor happo_ratio(const Tensor& new_log_prob, const Tensor& old_log_prob, const Tensor& valid, double clamp);

class Happo final : public OnPolicy {
 public:
  /// `config.run.algo` must be "happo": it gives the network an actor per agent and a joint critic.
  Happo(const RunConfig& config, const EnvShape& env, torch::Device device);

  Expected<UpdateStats> update(RolloutBatch& batch, const UpdateContext& context) override;

  /// The order of the agents in the next update: a permutation keyed by seed and version, or 0..N-1.
  std::vector<int64_t> agent_order() const;

  /// The pieces of one update, for tests: what one agent's sub-update and the critic's phase change.
  /// `advantage` of the batch is M; returns log pi_i^old [T, worlds].
  Expected<Tensor> train_agent(const RolloutBatch& batch, int64_t agent, const UpdateContext& context,
                               UpdateStats& stats, TermValues& terms, bool& goes_on);
  Expected<bool> train_critic(const RolloutBatch& batch, const UpdateContext& context, UpdateStats& stats,
                              TermValues& terms);

 private:
  Phase phase_of(int64_t agent);
  bool ended(PhaseEnd end, UpdateStats& stats) const;

  bool has_warned_of_rewards_ = false;
};

}  // namespace comrad::learn
