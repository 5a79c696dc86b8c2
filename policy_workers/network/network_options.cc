#include "policy_workers/network/network_options.h"

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::policy {

NetworkOptions NetworkOptions::from(const RunConfig& config, const EnvShape& env) {
  const auto widths = [](const std::string& text) {
    Expected<std::vector<int64_t>> parsed = parse_widths(text);
    COMRAD_CHECK(parsed.has_value(), "settings were resolved: widths are numbers");
    return *std::move(parsed);
  };
  NetworkOptions options;
  options.env = env;
  options.encoder = config.network.encoder;
  options.use_rnn = config.network.use_rnn;
  options.rnn_type = config.network.rnn_type;
  options.rnn_size = config.network.rnn_size;
  options.rnn_num_layers = config.network.rnn_num_layers;
  options.decoder_widths = widths(config.network.decoder_mlp_layers);
  options.layer_norm = has_layer_norm(config);
  options.init_gain = config.network.policy_init_gain;
  options.normalize_input = config.network.normalize_input;
  options.separate_agents = !config.network.share_parameters || config.run.algo->separate_agents;
  options.agent_id_input = config.network.agent_id_input;
  options.critic = config.run.algo->critic;
  if (config.run.algo->mixes_q_values()) options.init = Initialization::kFrameworkDefault;
  options.critic_view = config.network.mappo_critic_view;
  options.critic_widths = widths(config.network.critic_hidden_sizes);
  options.critic_rnn = config.network.happo_critic_rnn;
  if (sees_global_state(config)) options.global_state_count = env.global_state_count;
  // "auto" is in settings that were not resolved for a machine: then the same numbers everywhere.
  options.precision = config.collection.precision == Precision::kBf16 ? Precision::kBf16 : Precision::kFp32;
  return options;
}

CoreInput NetworkOptions::core(int64_t input_count, bool with_core) const {
  return {.kind = with_core ? word_of(rnn_type) : "none",
          .input_count = input_count,
          .hidden_count = rnn_size,
          .layer_count = rnn_num_layers};
}

int64_t NetworkOptions::core_state_count() const { return policy::core_state_count(core(0, use_rnn)); }

int64_t NetworkOptions::recurrent_state_count() const {
  return core_state_count() * (critic == CriticKind::kJoint && critic_rnn ? 2 : 1);
}

}  // namespace comrad::policy
