// What a network is made from: the settings of a run and the shapes of its environments.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "policy_workers/network/core.h"
#include "policy_workers/network/layers.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::policy {

/// With separate towers, an agent index or a critic other than kOwn the rows of every pass are whole worlds:
/// row = world * N + agent.
struct NetworkOptions {
  EnvShape env;
  std::string encoder = "simple";
  bool use_rnn = true;
  RnnType rnn_type = RnnType::kGru;
  int64_t rnn_size = 512;
  int64_t rnn_num_layers = 1;
  std::vector<int64_t> decoder_widths;  ///< ELU layers between core and heads
  Initialization init = Initialization::kOrthogonal;
  double init_gain = 1.0;
  bool layer_norm = false;  ///< q_layer_norm
  bool normalize_input = true;
  bool separate_agents = false;  ///< a tower and heads per agent instead of one for all
  bool agent_id_input = false;   ///< the agent's index, one-hot, beside the encoder's features
  CriticKind critic = CriticKind::kOwn;
  CriticView critic_view = CriticView::kOwnFirst;   ///< kCentral
  std::vector<int64_t> critic_widths = {512, 256};  ///< hidden, tanh after each; of kCentral and kJoint
  bool critic_rnn = true;                           ///< kJoint: a core per agent in the critic
  int64_t global_state_count =
      0;  ///< S: the team's critic (or mixer) also sees the world's true state; 0: it does not
  Precision precision = Precision::kFp32;

  static NetworkOptions from(const RunConfig& config, const EnvShape& env);
  /// The actors' core; `with_core` off: none.
  CoreInput core(int64_t input_count, bool with_core) const;
  /// Floats of one core's state per agent: layers * size for GRU, twice that for LSTM (all h, then all c);
  /// 0 without.
  int64_t core_state_count() const;
  /// Floats of recurrent state per agent: the actor's core, then the critic's if it has one.
  int64_t recurrent_state_count() const;
};

}  // namespace comrad::policy
