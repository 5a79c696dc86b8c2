// When a setting applies: n_step only with Q-learning, rnn_size only with a recurrent core.
// A row of a .def file may name one of the conditions below; rows that name none have that of their file (setting.cc). A
// flag whose condition does not hold is named at the start of a run. Stage: before a run.
#pragma once

#include <string_view>

#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// A test of the resolved settings, and its condition in words that follow "it applies with".
struct AppliesWhen {
  bool (*holds)(const RunConfig&) = nullptr;  ///< null: with all
  std::string_view words = "";
};

namespace with {

inline constexpr AppliesWhen everything = {[](const RunConfig&) { return true; }, ""};

// By the algorithm.
inline constexpr AppliesWhen on_policy = {[](const RunConfig& c) { return !c.run.algo->learns_q_values(); },
                                          "on-policy algorithms"};
inline constexpr AppliesWhen q_learning = {[](const RunConfig& c) { return c.run.algo->learns_q_values(); },
                                           "Q-learning"};
inline constexpr AppliesWhen central_critic = {
    [](const RunConfig& c) { return c.run.algo->critic == CriticKind::kCentral; }, "mappo's critic"};
inline constexpr AppliesWhen joint_critic = {
    [](const RunConfig& c) { return c.run.algo->critic == CriticKind::kJoint; }, "happo's critic"};
inline constexpr AppliesWhen team_critic = {
    [](const RunConfig& c) { return central_critic.holds(c) || joint_critic.holds(c); },
    "a critic of the whole team (mappo, happo)"};
inline constexpr AppliesWhen team_value = {
    [](const RunConfig& c) { return c.run.algo->can_see_global_state(); },
    "a critic or mixer that has a state (mappo, happo, qmix, qplex)"};
inline constexpr AppliesWhen agent_by_agent = {
    [](const RunConfig& c) { return c.run.algo->versions_by_agent; }, "updates agent after agent (happo)"};
inline constexpr AppliesWhen own_values = {[](const RunConfig& c) { return c.run.algo->learns_alone(); },
                                           "idqn"};
inline constexpr AppliesWhen mixers = {[](const RunConfig& c) { return c.run.algo->mixes_q_values(); },
                                       "mixers (vdn, qmix, qplex)"};
inline constexpr AppliesWhen state_mixers = {
    [](const RunConfig& c) { return mixers.holds(c) && team_value.holds(c); },
    "mixers that read a state (qmix, qplex)"};
inline constexpr AppliesWhen qmix = {[](const RunConfig& c) { return c.run.algo->mixer == MixerKind::kQmix; },
                                     "qmix"};
inline constexpr AppliesWhen qplex_attention = {
    [](const RunConfig& c) { return c.run.algo->mixer == MixerKind::kQplexAttention; }, "qplex_q"};
inline constexpr AppliesWhen qplex = {[](const RunConfig& c) {
                                        return c.run.algo->mixer == MixerKind::kQplexDuelling ||
                                               qplex_attention.holds(c);
                                      },
                                      "qplex_d and qplex_q"};
inline constexpr AppliesWhen qplex_lambda_layers = {
    [](const RunConfig& c) { return qplex.holds(c) && c.mixers.qplex_adv_hypernet_layers > 1; },
    "qplex and qplex_adv_hypernet_layers above 1"};

// By the network.
inline constexpr AppliesWhen recurrent_core = {[](const RunConfig& c) { return c.network.use_rnn; },
                                               "a recurrent core (use_rnn)"};
inline constexpr AppliesWhen recurrent_happo_critic = {
    [](const RunConfig& c) { return joint_critic.holds(c) && c.network.use_rnn; },
    "happo and a recurrent core (use_rnn)"};

// By the loss.
inline constexpr AppliesWhen normalised_returns = {
    [](const RunConfig& c) { return on_policy.holds(c) && c.optimisation.normalize_returns; },
    "on-policy algorithms and normalize_returns"};
inline constexpr AppliesWhen adaptive_rate = {
    [](const RunConfig& c) { return follows_kl(c.optimisation.lr_schedule); },
    "lr_schedule kl_adaptive_minibatch or kl_adaptive_epoch"};
inline constexpr AppliesWhen gae = {
    [](const RunConfig& c) { return on_policy.holds(c) && !c.on_policy.with_vtrace; },
    "on-policy algorithms without with_vtrace"};
inline constexpr AppliesWhen vtrace = {
    [](const RunConfig& c) { return on_policy.holds(c) && c.on_policy.with_vtrace; }, "with_vtrace"};
inline constexpr AppliesWhen an_exploration_loss = {
    [](const RunConfig& c) {
      return on_policy.holds(c) && c.on_policy.exploration_loss != ExplorationLoss::kNone;
    },
    "an exploration_loss of on-policy algorithms"};

// By the targets and batches of Q-learning.
inline constexpr AppliesWhen target_copies = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.target_update_tau == 1; },
    "Q-learning and target_update_tau 1"};
inline constexpr AppliesWhen resets = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.q_reset_every_updates > 0; },
    "Q-learning and q_reset_every_updates above 0"};
inline constexpr AppliesWhen n_step_targets = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.td_lambda < 0; },
    "Q-learning and td_lambda below 0"};
inline constexpr AppliesWhen no_replay_ratio = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.replay_ratio == 0; },
    "Q-learning and replay_ratio 0"};
inline constexpr AppliesWhen decisions_of_one = {
    [](const RunConfig& c) { return own_values.holds(c) && !c.network.use_rnn; },
    "idqn without a recurrent core"};
inline constexpr AppliesWhen joint_decisions = {
    [](const RunConfig& c) { return mixers.holds(c) && !c.network.use_rnn; },
    "mixers without a recurrent core"};
inline constexpr AppliesWhen sequences = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.network.use_rnn; },
    "Q-learning and a recurrent core (use_rnn)"};

// By the replay.
inline constexpr AppliesWhen a_choice_of_priorities = {
    [](const RunConfig& c) { return q_learning.holds(c) && (!c.network.use_rnn || c.replay.per_sequences); },
    "Q-learning without a recurrent core, or with per_sequences"};
inline constexpr AppliesWhen priorities = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.replay.per; },
    "a prioritised replay of Q-learning (per; with a recurrent core also per_sequences)"};
inline constexpr AppliesWhen priorities_of_sequences = {
    [](const RunConfig& c) { return priorities.holds(c) && sequences.holds(c); },
    "prioritised sequences of Q-learning (per, per_sequences, use_rnn)"};

// By the maps.
inline constexpr AppliesWhen one_generated_map = {
    [](const RunConfig& c) { return c.environment.wad.empty() && c.environment.layout_pool.empty(); },
    "a generated map (neither wad nor layout_pool)"};
inline constexpr AppliesWhen a_pool = {[](const RunConfig& c) { return !c.environment.layout_pool.empty(); },
                                       "layout_pool"};
inline constexpr AppliesWhen shared_rewards = {
    [](const RunConfig& c) { return c.environment.shared_reward_alpha > 0; }, "shared_reward_alpha above 0"};
inline constexpr AppliesWhen sequential = {
    [](const RunConfig& c) { return c.curriculum.curriculum == CurriculumKind::kSequential; },
    "curriculum sequential"};
inline constexpr AppliesWhen omni = {
    [](const RunConfig& c) { return c.curriculum.curriculum == CurriculumKind::kOmni; }, "curriculum omni"};
inline constexpr AppliesWhen learning_progress = {
    [](const RunConfig& c) {
      return c.curriculum.curriculum == CurriculumKind::kLearningProgress || omni.holds(c);
    },
    "curriculum learning_progress or omni"};
inline constexpr AppliesWhen plr = {
    [](const RunConfig& c) { return c.curriculum.curriculum == CurriculumKind::kPlr; }, "curriculum plr"};

// By how decisions are collected.
inline constexpr AppliesWhen free_running = {[](const RunConfig& c) { return !c.collection.deterministic; },
                                             "deterministic off"};

// By the hosts of the run.
inline constexpr AppliesWhen join_endpoint = {[](const RunConfig& c) {
                                                return c.hosts.serve ||
                                                       (!c.hosts.hosts.empty() && c.hosts.hosts != "none") ||
                                                       c.hosts.link == LinkKind::kDds;
                                              },
                                              "serve, hosts or link dds"};
inline constexpr AppliesWhen host_link = {
    [](const RunConfig& c) { return join_endpoint.holds(c) || c.hosts.publish; },
    "serve, hosts, link dds, publish or `comrad join`"};

}  // namespace with
}  // namespace comrad
