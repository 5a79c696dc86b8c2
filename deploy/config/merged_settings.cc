#include "deploy/config/merged_settings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <thread>
#include <type_traits>

#include "rollout_buffer/core/recipes.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

/// What a checkpoint's tensors or a run's data depend on.
constexpr std::array kFixedInARun = {"scenario",
                                     "algo",
                                     "preset",  // its values are in config.toml already
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
                                     "mappo_critic_view",
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

/// The name of a setting that `key` means, which may be an old one; `key` itself where it is unknown.
std::string canonical_setting(const std::string& key) {
  std::string canonical = key;
  RunConfig any;
  visit_settings(any, [&](const char* name, auto&, const char*, std::initializer_list<const char*> aliases) {
    if (std::any_of(aliases.begin(), aliases.end(), [&key](const char* alias) { return key == alias; }))
      canonical = name;
  });
  return canonical;
}

using Texts = std::map<std::string, std::string>;
Texts all_texts(const RunConfig& config) {
  Texts texts;
  visit_settings(config, [&texts](const char* name, const auto& value, const char*,
                                  std::initializer_list<const char*>) { texts[name] = to_text(value); });
  return texts;
}

/// A RunConfig that remembers which layer each of its values came from.
class Layers {
 public:
  Layers(RunConfig lowest, const std::string& name) : config_(std::move(lowest)) {
    for (const auto& [setting, text] : all_texts(config_)) from_[setting] = name;
  }
  /// The settings that `layer` names are its own even where their value stays.
  Status put(const SettingsLayer& layer, const std::string& name) {
    COMRAD_TRY(change(name, [&layer](RunConfig& config) { return apply_layer(config, layer); }));
    for (const auto& [key, text] : layer.values) from_[canonical_setting(key)] = name;
    return {};
  }
  /// What `edit` changes came from the layer `name`.
  template <typename Edit>
  Status change(const std::string& name, Edit&& edit) {
    const Texts before = all_texts(config_);
    COMRAD_TRY(edit(config_));
    for (const auto& [setting, text] : all_texts(config_))
      if (text != before.at(setting)) from_[setting] = name;
    return {};
  }
  const RunConfig& config() const { return config_; }
  std::map<std::string, std::string>& from() { return from_; }

 private:
  RunConfig config_;
  std::map<std::string, std::string> from_;
};

/// How much of the team's reward each agent gets where nobody asked for a share.
double default_alpha(const RunConfig& config, const ScenarioDescription& scenario) {
  if (learns_q_values(config)) return 0;  // mixers add the rewards up, and idqn's agents learn from their own
  if (config.algo == "happo") return 1;   // its joint critic has one value for all, so they need one reward
  return scenario.shared_reward_alpha;
}

/// Fills in what is still open: from the scenario, then from the host.
Expected<MergedSettings> complete(Layers layers, ScenarioDescription scenario, int core_count) {
  const bool is_scenarios = layers.config().algo == "ippo" || layers.config().algo == "mappo";
  COMRAD_TRY(layers.change(is_scenarios ? "scenario" : "algorithm", [&scenario](RunConfig& config) -> Status {
    if (config.shared_reward_alpha < 0) config.shared_reward_alpha = default_alpha(config, scenario);
    return {};
  }));
  COMRAD_TRY(layers.change("scenario", [&scenario](RunConfig& config) -> Status {
    config.num_agents = scenario.env.num_agents;
    return {};
  }));
  COMRAD_TRY(
      layers.change("automatic", [&](RunConfig& config) { return resolve_settings(config, core_count); }));
  return MergedSettings{layers.config(), std::move(scenario), std::move(layers.from())};
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

  COMRAD_TRY_ASSIGN(const SettingsLayer preset, preset_settings(chosen.preset, chosen.algo));
  Layers layers(RunConfig(), "built-in");
  COMRAD_TRY(layers.put(algorithm, "algorithm"));
  COMRAD_TRY(layers.put(preset, "preset"));
  COMRAD_TRY(layers.put(qplex_preset_settings(chosen.qplex_preset), "preset"));
  COMRAD_TRY(layers.put(scenario_settings(scenario.training, chosen.preset, chosen.algo), "scenario"));
  COMRAD_TRY(layers.put(changes, changes.origin));
  COMRAD_TRY(layers.put(file, "file"));
  COMRAD_TRY(layers.put(user.typed, "command line"));
  // TD(lambda) runs over sequences. Where somebody turns the recurrent core off the preset's row falls away; one
  // that was asked for is refused by resolve_settings.
  if (!layers.config().use_rnn && layers.from().at("td_lambda") == "preset")
    COMRAD_TRY(layers.put({"", {{"td_lambda", real_text(RunConfig().td_lambda)}}}, "automatic"));
  if (layers.config().use_additional_input !=
      chosen.use_additional_input) {  // the scenario's own row decides
    COMRAD_TRY_ASSIGN(scenario,
                      describe(chosen.scenario, chosen.num_agents, layers.config().use_additional_input));
  }
  return complete(std::move(layers), std::move(scenario), core_count);
}

Expected<MergedSettings> merge_onto_run(const RunConfig& run, const UserSettings& user,
                                        const Describe& describe, int core_count) {
  COMRAD_TRY_ASSIGN(const SettingsLayer file, file_layer(user));
  Layers layers(run, "run");
  COMRAD_TRY(layers.put(file, "file"));
  COMRAD_TRY(layers.put(user.typed, "command line"));
  COMRAD_TRY(layers.change("run", [&run](RunConfig& config) -> Status {
    if (config.num_agents == 0) config.num_agents = run.num_agents;
    return {};
  }));
  const RunConfig& config = layers.config();
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
      if (!changed(name)) COMRAD_TRY(layers.put({"automatic size", {{name, "0"}}}, "automatic"));

  COMRAD_TRY_ASSIGN(ScenarioDescription scenario,
                    describe(config.scenario, config.num_agents, config.use_additional_input));
  return complete(std::move(layers), std::move(scenario), core_count);
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
