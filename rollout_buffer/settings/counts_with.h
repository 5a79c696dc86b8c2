// With which other settings a setting means something: n_step only with Q-learning, rnn_size only with a recurrent core.
// A row of a .def file may name one of the conditions below; rows that name none have that of their file (setting.cc). A
// flag whose condition does not hold is named at the start of a run. Stage: before a run.
#pragma once

#include <string_view>

#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// A test of the resolved settings, and what it asks for in words that follow "it counts with".
struct CountsWith {
  bool (*holds)(const RunConfig&) = nullptr;  ///< null: with all
  std::string_view words = "";
};

namespace with {

inline constexpr CountsWith everything = {[](const RunConfig&) { return true; }, ""};

// By the algorithm.
inline constexpr CountsWith on_policy = {[](const RunConfig& c) { return !c.run.algo->learns_q_values(); },
                                         "on-policy algorithms"};
inline constexpr CountsWith q_learning = {[](const RunConfig& c) { return c.run.algo->learns_q_values(); },
                                          "Q-learning"};
inline constexpr CountsWith central_critic = {
    [](const RunConfig& c) { return c.run.algo->critic == CriticKind::kCentral; }, "mappo's critic"};
inline constexpr CountsWith joint_critic = {
    [](const RunConfig& c) { return c.run.algo->critic == CriticKind::kJoint; }, "happo's critic"};
inline constexpr CountsWith team_critic = {
    [](const RunConfig& c) { return central_critic.holds(c) || joint_critic.holds(c); },
    "a critic of the whole team (mappo, happo)"};
inline constexpr CountsWith team_value = {
    [](const RunConfig& c) { return c.run.algo->can_see_global_state(); },
    "a critic or mixer that has a state (mappo, happo, qmix, qplex)"};
inline constexpr CountsWith agent_by_agent = {
    [](const RunConfig& c) { return c.run.algo->versions_by_agent; }, "updates agent after agent (happo)"};
inline constexpr CountsWith own_values = {[](const RunConfig& c) { return c.run.algo->learns_alone(); },
                                          "idqn"};
inline constexpr CountsWith mixers = {[](const RunConfig& c) { return c.run.algo->mixes_q_values(); },
                                      "mixers (vdn, qmix, qplex)"};
inline constexpr CountsWith state_mixers = {
    [](const RunConfig& c) { return mixers.holds(c) && team_value.holds(c); },
    "mixers that read a state (qmix, qplex)"};
inline constexpr CountsWith qmix = {[](const RunConfig& c) { return c.run.algo->mixer == MixerKind::kQmix; },
                                    "qmix"};
inline constexpr CountsWith qplex_attention = {
    [](const RunConfig& c) { return c.run.algo->mixer == MixerKind::kQplexAttention; }, "qplex_q"};
inline constexpr CountsWith qplex = {[](const RunConfig& c) {
                                       return c.run.algo->mixer == MixerKind::kQplexDuelling ||
                                              qplex_attention.holds(c);
                                     },
                                     "qplex_d and qplex_q"};
inline constexpr CountsWith qplex_lambda_layers = {
    [](const RunConfig& c) { return qplex.holds(c) && c.mixers.qplex_adv_hypernet_layers > 1; },
    "qplex and qplex_adv_hypernet_layers above 1"};

// By the network.
inline constexpr CountsWith recurrent_core = {[](const RunConfig& c) { return c.network.use_rnn; },
                                              "a recurrent core (use_rnn)"};
inline constexpr CountsWith recurrent_happo_critic = {
    [](const RunConfig& c) { return joint_critic.holds(c) && c.network.use_rnn; },
    "happo and a recurrent core (use_rnn)"};

// By the loss.
inline constexpr CountsWith normalised_returns = {
    [](const RunConfig& c) { return on_policy.holds(c) && c.optimisation.normalize_returns; },
    "on-policy algorithms and normalize_returns"};
inline constexpr CountsWith adaptive_rate = {
    [](const RunConfig& c) { return follows_kl(c.optimisation.lr_schedule); },
    "lr_schedule kl_adaptive_minibatch or kl_adaptive_epoch"};
inline constexpr CountsWith gae = {
    [](const RunConfig& c) { return on_policy.holds(c) && !c.on_policy.with_vtrace; },
    "on-policy algorithms without with_vtrace"};
inline constexpr CountsWith vtrace = {
    [](const RunConfig& c) { return on_policy.holds(c) && c.on_policy.with_vtrace; }, "with_vtrace"};
inline constexpr CountsWith an_exploration_loss = {
    [](const RunConfig& c) {
      return on_policy.holds(c) && c.on_policy.exploration_loss != ExplorationLoss::kNone;
    },
    "an exploration_loss of on-policy algorithms"};

// By the targets and batches of Q-learning.
inline constexpr CountsWith target_copies = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.target_update_tau == 1; },
    "Q-learning and target_update_tau 1"};
inline constexpr CountsWith n_step_targets = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.td_lambda < 0; },
    "Q-learning and td_lambda below 0"};
inline constexpr CountsWith no_replay_ratio = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.q_learning.replay_ratio == 0; },
    "Q-learning and replay_ratio 0"};
inline constexpr CountsWith decisions_of_one = {
    [](const RunConfig& c) { return own_values.holds(c) && !c.network.use_rnn; },
    "idqn without a recurrent core"};
inline constexpr CountsWith joint_decisions = {
    [](const RunConfig& c) { return mixers.holds(c) && !c.network.use_rnn; },
    "mixers without a recurrent core"};
inline constexpr CountsWith sequences = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.network.use_rnn; },
    "Q-learning and a recurrent core (use_rnn)"};

// By the replay.
inline constexpr CountsWith a_choice_of_priorities = {
    [](const RunConfig& c) { return q_learning.holds(c) && (!c.network.use_rnn || c.replay.per_sequences); },
    "Q-learning without a recurrent core, or with per_sequences"};
inline constexpr CountsWith priorities = {
    [](const RunConfig& c) { return q_learning.holds(c) && c.replay.per; },
    "a prioritised replay of Q-learning (per; with a recurrent core also per_sequences)"};
inline constexpr CountsWith priorities_of_sequences = {
    [](const RunConfig& c) { return priorities.holds(c) && sequences.holds(c); },
    "prioritised sequences of Q-learning (per, per_sequences, use_rnn)"};

// By the maps.
inline constexpr CountsWith one_generated_map = {
    [](const RunConfig& c) { return c.environment.wad.empty() && c.environment.layout_pool.empty(); },
    "a generated map (neither wad nor layout_pool)"};
inline constexpr CountsWith a_pool = {[](const RunConfig& c) { return !c.environment.layout_pool.empty(); },
                                      "layout_pool"};
inline constexpr CountsWith shared_rewards = {
    [](const RunConfig& c) { return c.environment.shared_reward_alpha > 0; }, "shared_reward_alpha above 0"};
inline constexpr CountsWith sequential = {
    [](const RunConfig& c) { return c.curriculum.curriculum == CurriculumKind::kSequential; },
    "curriculum sequential"};
inline constexpr CountsWith omni = {
    [](const RunConfig& c) { return c.curriculum.curriculum == CurriculumKind::kOmni; }, "curriculum omni"};
inline constexpr CountsWith learning_progress = {
    [](const RunConfig& c) {
      return c.curriculum.curriculum == CurriculumKind::kLearningProgress || omni.holds(c);
    },
    "curriculum learning_progress or omni"};
inline constexpr CountsWith plr = {
    [](const RunConfig& c) { return c.curriculum.curriculum == CurriculumKind::kPlr; }, "curriculum plr"};

// By how decisions are collected.
inline constexpr CountsWith free_running = {[](const RunConfig& c) { return !c.collection.deterministic; },
                                            "deterministic off"};

// By the hosts that take part.
inline constexpr CountsWith a_door = {[](const RunConfig& c) {
                                        return c.hosts.serve ||
                                               (!c.hosts.hosts.empty() && c.hosts.hosts != "none") ||
                                               c.hosts.link == LinkKind::kDds;
                                      },
                                      "serve, hosts or link dds"};
inline constexpr CountsWith a_link = {[](const RunConfig& c) { return a_door.holds(c); },
                                      "serve, hosts, link dds or `comrad join`"};

}  // namespace with
}  // namespace comrad
