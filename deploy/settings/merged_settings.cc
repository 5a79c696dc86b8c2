#include "deploy/settings/merged_settings.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <initializer_list>
#include <utility>

#include "deploy/settings/layers.h"
#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/encoder_layers.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/recipes.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/reward_weights.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

std::string absolute(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::absolute(path, ignored).lexically_normal().string();
}

/// The scenario, by its whole path where a path names it: a run continues from whatever folder.
std::string whole_path(const std::string& scenario) {
  const bool is_path = scenario.find('/') != std::string::npos || names_vizdoom_config(scenario);
  return is_path ? absolute(scenario) : scenario;
}

SettingsLayer with_whole_paths(SettingsLayer layer) {
  for (auto& [key, value] : layer.values) {
    const std::string setting = canonical_setting(key);
    if (setting == "scenario") value = whole_path(value);
    if (setting == "encoder" && is_encoder_file(value)) value = absolute(value);
  }
  return layer;
}

/// Whether two encoders are files of the same bytes: a run keeps a copy of its module, and the user names the original.
bool are_equal_files(const std::string& one, const std::string& other) {
  if (!is_encoder_file(one) || !is_encoder_file(other)) return false;
  const Expected<std::string> here = read_encoder_file(one), there = read_encoder_file(other);
  return here && there && *here == *there;
}

/// Read from the upper layers first: what chooses the lower layers and the scenario.
constexpr std::array<std::string_view, 9> kChoices = {
    "scenario", "variant", "num_agents",   "heads", "use_additional_input",
    "algo",     "mixer",   "qplex_preset", "preset"};

/// How much of the team's reward each agent gets where no share is set.
double default_alpha(const RunConfig& config, const ScenarioDescription& scenario) {
  switch (config.run.algo->reward_share) {
    case RewardShare::kOwn:
      return 0;
    case RewardShare::kTeam:
      return 1;
    case RewardShare::kOfTheScenario:
      break;
  }
  return scenario.shared_reward_alpha;
}

/// The user's file on top of a run, which has worked its own values out.
Expected<SettingsLayer> file_layer_onto_run(const UserSettings& user) {
  if (user.config_file.empty()) return SettingsLayer{};
  COMRAD_TRY_ASSIGN(SettingsLayer layer, read_settings_toml(user.config_file));
  std::erase_if(layer.values, [&layer](const auto& value) {
    return std::ranges::any_of(layer.explicit_values, [&value](const auto& asked) {
      return canonical_setting(asked.first) == canonical_setting(value.first);
    });
  });
  layer.explicit_values.clear();
  return layer;
}

/// --reward names terms that the scenario has.
Status check_rewards(const RunConfig& config, const ScenarioDescription& scenario) {
  COMRAD_TRY_ASSIGN(const auto weights, parse_reward_weights(config.environment.reward));
  for (const auto& [name, weight] : weights)
    if (std::ranges::count(scenario.rewards, name) == 0)
      return Error{ErrorCode::kBadInput, "--reward=" + config.environment.reward + ": " +
                                             unknown_word("reward term", name, scenario.rewards)};
  return {};
}

/// Fills in what is still open: from the scenario, then from the host.
Expected<MergedSettings> complete(LayeredConfig layers, ScenarioDescription scenario, int core_count) {
  COMRAD_TRY(check_rewards(layers.config, scenario));
  if (!scenario.folder.empty())
    COMRAD_TRY(layers.change(layers.from.at("scenario"), [&scenario](RunConfig& config) -> Status {
      config.run.scenario = scenario.folder;
      return {};
    }));
  const RunConfig asked = layers.config;
  if (const int64_t version = asked.environment.scenario_version; version != 0 && version != scenario.version)
    return Error{ErrorCode::kBadInput,
                 fmt::format("--scenario_version={}: {} is at version {} here, other rules than that run's; "
                             "train anew under another --experiment",
                             version, asked.run.scenario, scenario.version)};
  const bool is_scenarios = layers.config.run.algo->reward_share == RewardShare::kOfTheScenario;
  COMRAD_TRY(layers.change(is_scenarios ? "scenario" : "algorithm", [&scenario](RunConfig& config) -> Status {
    if (config.environment.shared_reward_alpha < 0)
      config.environment.shared_reward_alpha = default_alpha(config, scenario);
    return {};
  }));
  COMRAD_TRY(layers.change("scenario", [&scenario](RunConfig& config) -> Status {
    config.environment.num_agents = scenario.env.num_agents;
    return {};
  }));
  COMRAD_TRY(layers.change("automatic", [&](RunConfig& config) {
    config.environment.scenario_version = scenario.version;
    return resolve_settings(config, core_count);
  }));
  if (!sees_global_state(layers.config)) scenario.env.global_state_count = 0;
  MergedSettings merged{layers.config, std::move(scenario), std::move(layers.from), {}};
  for (const SettingRow& row : setting_rows())
    if (row.text(merged.config) != row.text(asked))
      merged.explicit_values.emplace_back(std::string(row.name), row.text(asked));
  return merged;
}

bool is_of_recipe(const std::string& from) {
  return from == "algorithm" || from == "preset" || from == "scenario";
}
bool is_users(const LayeredConfig& layers, const std::string& setting) {
  const std::string& from = layers.from.at(setting);
  return from != "built-in" && !is_of_recipe(from);
}

/// These settings have their defaults again where a recipe set them.
Status drop_recipe(LayeredConfig& layers, std::initializer_list<const char*> settings) {
  for (const char* setting : settings)
    if (is_of_recipe(layers.from.at(setting)))
      COMRAD_TRY(layers.put({"automatic", {"", {{setting, setting_text(RunConfig(), setting)}}}}));
  return {};
}

}  // namespace

Expected<SettingsLayer> file_layer(const UserSettings& user) {
  if (user.config_file.empty()) return SettingsLayer{};
  COMRAD_TRY_ASSIGN(SettingsLayer layer, read_settings_toml(user.config_file));
  layer.values.insert(layer.values.end(), layer.explicit_values.begin(), layer.explicit_values.end());
  return layer;
}

Expected<MergedSettings> merge_new(const UserSettings& user, const Describe& describe, int core_count,
                                   const SettingsLayer& changes) {
  COMRAD_TRY_ASSIGN(SettingsLayer file, file_layer(user));
  file = with_whole_paths(std::move(file));
  const SettingsLayer typed = with_whole_paths(user.typed);
  RunConfig chosen;
  for (const SettingsLayer* layer : {&changes, &std::as_const(file), &typed})
    COMRAD_TRY(apply_layer(chosen, only(*layer, kChoices)));
  COMRAD_TRY_ASSIGN(ScenarioDescription scenario, describe(chosen));

  const RunSettings& run = chosen.run;
  const NamedLayer all[] = {{"algorithm", algorithm_defaults(run.algo)},
                            {"preset", preset_settings(run.preset, run.algo)},
                            {"preset", qplex_preset_settings(chosen.mixers.qplex_preset)},
                            {"scenario", scenario_settings(scenario.training, run.preset, run.algo)},
                            {changes.origin, changes},
                            {"file", file},
                            {"command line", typed}};
  RunConfig lowest;
  lowest.run.algo = run.algo;
  COMRAD_TRY_ASSIGN(LayeredConfig layers, merge(lowest, "built-in", all));
  // Recipes count in sequences for mixers, which have a recurrent core, and in decisions for idqn, which has none. Their
  // rows fall away where the user chose the other core.
  if (layers.config.network.use_rnn != run.algo->mixes_q_values())
    COMRAD_TRY(drop_recipe(layers, {"td_lambda", "replay_batch_size"}));
  // A scenario's own maps do where the user chose others.
  if (is_users(layers, "wad") || is_users(layers, "layout_seed") || is_users(layers, "layout_pool"))
    COMRAD_TRY(drop_recipe(layers, {"layout_pool", "layout_swap_every", "curriculum"}));
  if (layers.config.environment.use_additional_input !=
      chosen.environment.use_additional_input) {  // the scenario's own row decides
    chosen.environment.use_additional_input = layers.config.environment.use_additional_input;
    COMRAD_TRY_ASSIGN(scenario, describe(chosen));
  }
  return complete(std::move(layers), std::move(scenario), core_count);
}

Expected<MergedSettings> merge_onto_run(const RunConfig& made, const UserSettings& user,
                                        const Describe& describe, int core_count) {
  COMRAD_TRY_ASSIGN(SettingsLayer file, file_layer_onto_run(user));
  RunConfig run = made;
  run.run.scenario = whole_path(made.run.scenario);
  const NamedLayer all[] = {{"file", with_whole_paths(std::move(file))},
                            {"command line", with_whole_paths(user.typed)}};
  COMRAD_TRY_ASSIGN(LayeredConfig layers, merge(run, "run", all));
  const RunConfig& config = layers.config;
  COMRAD_TRY(layers.change("run", [&run](RunConfig& merged) -> Status {
    if (merged.environment.num_agents == 0) merged.environment.num_agents = run.environment.num_agents;
    return {};
  }));
  if (are_equal_files(config.network.encoder, run.network.encoder))
    COMRAD_TRY(layers.put({"run", {"run", {{"encoder", run.network.encoder}}}}));
  for (const SettingRow& row : setting_rows())
    if (row.traits.fixed_in_a_run && row.text(config) != row.text(run))
      return Error{
          ErrorCode::kBadInput,
          "--" + std::string(row.name) + "=" + row.text(config) + ": the run was made with " + row.text(run) +
              "; leave it out, or start anew with another --experiment or --restart_behavior=restart"};

  const auto changed = [&](const SettingRow& row) { return row.text(config) != row.text(run); };
  const bool is_sized_anew = std::ranges::any_of(
      setting_rows(), [&](const SettingRow& row) { return row.traits.sizes_the_arena && changed(row); });
  if (is_sized_anew)
    for (const SettingRow& row : setting_rows())
      if (row.traits.is_automatic_size && !changed(row))
        COMRAD_TRY(layers.put({"automatic", {"automatic size", {{std::string(row.name), "0"}}}}));

  COMRAD_TRY_ASSIGN(ScenarioDescription scenario, describe(config));
  return complete(std::move(layers), std::move(scenario), core_count);
}

Expected<RunPlace> place_of_run(const SettingsLayer& file, const SettingsLayer& typed) {
  constexpr std::array<std::string_view, 3> kPlace = {"train_dir", "experiment", "restart_behavior"};
  RunConfig asked;
  for (const SettingsLayer* layer : {&file, &typed}) COMRAD_TRY(apply_layer(asked, only(*layer, kPlace)));
  return RunPlace{.train_dir = absolute(asked.run.train_dir),
                  .is_default_train_dir = asked.run.train_dir == RunConfig().run.train_dir,
                  .experiment = asked.run.experiment,
                  .restart_behavior = asked.run.restart_behavior};
}

}  // namespace comrad::deploy
