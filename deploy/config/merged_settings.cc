#include "deploy/config/merged_settings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <thread>
#include <type_traits>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

/// What a checkpoint's tensors or a run's data depend on.
constexpr std::array kFixedInARun = {"scenario",
                                     "algo",
                                     "num_agents",
                                     "encoder_conv_architecture",
                                     "use_rnn",
                                     "rnn_type",
                                     "rnn_size",
                                     "rnn_num_layers",
                                     "decoder_mlp_layers",
                                     "share_parameters",
                                     "agent_id_input",
                                     "critic_hidden_sizes",
                                     "happo_critic_rnn",
                                     "normalize_input",
                                     "normalize_returns",
                                     "use_additional_input",
                                     "curriculum",
                                     "mixer",
                                     "qmix_embed_dim",
                                     "qmix_hypernet_hidden",
                                     "qplex_embed_dim",
                                     "qplex_hypernet_embed",
                                     "qplex_adv_hypernet_layers",
                                     "qplex_adv_hypernet_embed",
                                     "qplex_num_kernel",
                                     "qplex_n_head",
                                     "qplex_weighted_head",
                                     "qplex_nonlinear",
                                     "qplex_state_bias"};

/// What the automatic sizes are made from.
constexpr std::array kSizesAnArena = {
    "num_workers", "num_envs_per_worker", "worker_num_splits",        "policy_workers",
    "rollout",     "batch_size",          "num_batches_to_accumulate"};
constexpr std::array kAutomaticSizes = {"trajectory_slabs", "min_batch", "max_batch"};

std::string to_text(const std::string& value) { return value; }
std::string to_text(bool value) { return value ? "true" : "false"; }
std::string to_text(int64_t value) { return std::to_string(value); }
std::string to_text(double value) { return real_text(value); }

Expected<SettingsLayer> file_layer(const UserSettings& user) {
  if (user.config_file.empty()) return SettingsLayer{};
  return read_settings_toml(user.config_file);
}

Expected<MergedSettings> complete(RunConfig config, ScenarioDescription scenario, int core_count) {
  config.num_agents = scenario.env.num_agents;
  // Sharing is for actor-critics; mixers add the rewards up, and idqn's agents learn from their own.
  if (config.shared_reward_alpha < 0)
    config.shared_reward_alpha = learns_q_values(config) ? 0 : scenario.shared_reward_alpha;
  if (config.seq_max_return == 0) config.seq_max_return = std::max(scenario.ceiling, 0.0);
  if (config.lp_max_return == 0 && scenario.ceiling > config.lp_min_return)
    config.lp_max_return = scenario.ceiling;
  COMRAD_TRY(resolve_settings(config, core_count));
  return MergedSettings{std::move(config), std::move(scenario)};
}

}  // namespace

std::string setting_text(const RunConfig& config, const std::string& name) {
  std::string text;
  visit_settings(config,
                 [&](const char* known, const auto& value, const char*, std::initializer_list<const char*>) {
                   if (name == known) text = to_text(value);
                 });
  return text;
}

Expected<MergedSettings> merge_new(const UserSettings& user, const Describe& describe, int core_count,
                                   const SettingsLayer& changes) {
  COMRAD_TRY_ASSIGN(const SettingsLayer file, file_layer(user));
  // The upper layers choose the lower ones: the scenario and the algorithm are read off them first.
  RunConfig chosen;
  for (const SettingsLayer* layer : {&changes, &file, &user.typed}) COMRAD_TRY(apply_layer(chosen, *layer));
  COMRAD_TRY_ASSIGN(const SettingsLayer algorithm, algorithm_defaults(chosen.algo));
  COMRAD_TRY_ASSIGN(ScenarioDescription scenario,
                    describe(chosen.scenario, chosen.num_agents, chosen.use_additional_input));

  RunConfig config;
  const SettingsLayer preset = qplex_preset_settings(chosen.qplex_preset);
  const SettingsLayer training = settings_for_algorithm(scenario.training, chosen.algo);
  for (const SettingsLayer* layer : {&changes, &algorithm, &preset, &training, &file, &user.typed})
    COMRAD_TRY(apply_layer(config, *layer));
  if (config.use_additional_input != chosen.use_additional_input) {  // the scenario's own default decides
    COMRAD_TRY_ASSIGN(scenario, describe(chosen.scenario, chosen.num_agents, config.use_additional_input));
  }
  return complete(std::move(config), std::move(scenario), core_count);
}

Expected<MergedSettings> merge_onto_run(const RunConfig& run, const UserSettings& user,
                                        const Describe& describe, int core_count) {
  COMRAD_TRY_ASSIGN(const SettingsLayer file, file_layer(user));
  RunConfig config = run;
  COMRAD_TRY(apply_layer(config, file));
  COMRAD_TRY(apply_layer(config, user.typed));
  if (config.num_agents == 0) config.num_agents = run.num_agents;
  for (const char* name : kFixedInARun)
    if (setting_text(config, name) != setting_text(run, name))
      return Error{
          ErrorCode::kBadInput,
          std::string("--") + name + "=" + setting_text(config, name) + ": the run was made with " +
              setting_text(run, name) +
              "; leave it out, or start anew with another --experiment or --restart_behavior=restart"};

  auto changed = [&](const char* name) { return setting_text(config, name) != setting_text(run, name); };
  if (std::any_of(kSizesAnArena.begin(), kSizesAnArena.end(), changed))
    for (const char* name : kAutomaticSizes)
      if (!changed(name)) COMRAD_TRY(apply_layer(config, {"automatic size", {{name, "0"}}}));

  COMRAD_TRY_ASSIGN(ScenarioDescription scenario,
                    describe(config.scenario, config.num_agents, config.use_additional_input));
  return complete(std::move(config), std::move(scenario), core_count);
}

int usable_cores() {
  int cores = std::max(1u, std::thread::hardware_concurrency());  // honours the CPU mask
  std::ifstream quota_file("/sys/fs/cgroup/cpu.max");
  std::string quota;
  double period = 0;
  if (quota_file >> quota >> period && quota != "max" && period > 0)
    cores = std::min(cores,
                     std::max(1, static_cast<int>(std::ceil(std::strtod(quota.c_str(), nullptr) / period))));
  return cores;
}

}  // namespace comrad::deploy
