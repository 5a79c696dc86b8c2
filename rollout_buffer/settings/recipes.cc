#include "rollout_buffer/settings/recipes.h"

#include <array>
#include <string>
#include <vector>

namespace comrad {
namespace {

// What differs from RunConfig's defaults. Those are the benchmark's own ("effective defaults" of its May 2026 logs) with
// the corrections that learner/ALGORITHMS.md names (time-outs bootstrap, every head explores on its own, PER's beta takes
// the whole run, ...), so the algorithm's rows over them are the published launch, and the preset `paper` adds only what
// one value for all presets cannot say.
//
// `small` is what learns most per hour on a few cores, `gpu` the same where a GPU computes: its rows stand above those of
// `small`. To try another value, change it here.
constexpr RecipeRow kRecipeRows[] = {
    // The algorithm's own, in every preset.
    {"", "ippo mappo", "use_rnn", "true", "a benchmark launch: LSTM of 512 units"},
    {"", "ippo mappo", "rnn_type", "lstm", "a benchmark launch: LSTM of 512 units"},
    {"", "ippo mappo", "rnn_size", "512", "a benchmark launch: LSTM of 512 units"},
    {"", "ippo mappo", "num_epochs", "4", "a benchmark launch: four passes over every batch"},
    {"", "on_policy", "batch_size", "4096", "a benchmark launch: 128 trajectories of 32 decisions"},
    {"", "on_policy", "num_batches_per_epoch", "1", "a benchmark launch: whole batches"},
    {"", "happo", "use_rnn", "true", "a benchmark launch: GRU of 512 units in actors and critic"},
    {"", "happo", "rnn_type", "gru", "a benchmark launch: GRU of 512 units in actors and critic"},
    {"", "happo", "rnn_size", "512", "a benchmark launch: GRU of 512 units in actors and critic"},
    {"", "happo", "happo_critic_rnn", "true", "a benchmark launch: GRU of 512 units in actors and critic"},
    {"", "happo", "num_epochs", "1", "a benchmark launch: one pass, agent after agent"},
    {"", "happo", "share_parameters", "false", "HAPPO updates one network per agent"},
    {"", "happo", "lr_schedule", "linear_decay", "a benchmark launch"},
    {"", "happo", "max_policy_lag", "0",
     "automatic, 1000 x (agents + 1): a batch makes a version for every agent and one for the critic"},
    {"", "on_policy", "adam_eps", "1e-6", "the benchmark's, and Sample Factory's"},
    {"", "idqn", "use_rnn", "false", "a benchmark launch: feed-forward"},
    {"", "idqn", "batch_size", "4096", "a benchmark launch: four updates for every 4096 decisions"},
    {"", "mixers", "use_rnn", "true", "a benchmark launch: GRU of 512 units"},
    {"", "mixers", "rnn_type", "gru", "a benchmark launch: GRU of 512 units"},
    {"", "mixers", "rnn_size", "512", "a benchmark launch: GRU of 512 units"},
    {"", "mixers", "batch_size", "4096", "a benchmark launch: four updates for every 4096 decisions"},
    {"", "vdn qmix", "replay_batch_size", "64", "a benchmark launch"},
    {"", "qplex_d qplex_q", "replay_batch_size", "16", "a benchmark launch: its mixer is larger"},
    {"", "q_learning", "adam_eps", "1e-8",
     "Q-gradients are small: with 1e-6 the root of Adam's second moment lay below epsilon in the gates of "
     "recurrent cores, whose steps shrank up to a hundredfold; the reference's mixers use 1e-8, too"},

    // paper: the published configuration where the algorithm's row has another value.
    {"paper", "idqn", "adam_eps", "1e-6", "published; only the reference's mixers leave it at 1e-8"},

    // small: on-policy.
    {"small", "on_policy", "batch_size", "1024",
     "four times as many updates per frame; a run of 8 M env frames has 2 000"},
    {"small", "on_policy", "num_epochs", "1",
     "on two cores a further pass costs more time than the frames that it saves; a second one hurt IPPO"},
    {"small", "on_policy", "num_batches_to_accumulate", "1",
     "one batch in waiting keeps the policy lag near 4, with 8 environments near 2"},
    {"small", "on_policy", "num_envs_per_worker", "8",
     "0.9 of the rate of 16 on two cores, and the data is half as old"},
    {"small", "on_policy mixers", "encoder", "impala",
     "with the smaller core two fifths of the published network's arithmetic: 1.7 times the env frames in "
     "the same minutes, with QMIX 1.6 times (RECIPES.md)"},
    {"small", "on_policy mixers", "rnn_size", "256", "as the encoder"},
    {"small", "on_policy", "rnn_type", "gru", "three quarters of an LSTM's arithmetic"},
    {"small", "on_policy", "learning_rate", "4e-4",
     "four times the published rate, for 2 000 updates instead of 24 000"},
    {"small", "on_policy", "ppo_clip_ratio", "0.2",
     "at this rate and lag a third to a half of the samples lay outside the interval of 0.1 on their first "
     "pass; with 8 environments and this IPPO scored 2.3 to 3.3 times as much on Platform Chain "
     "(RECIPES.md)"},

    // small: Q-learning.
    {"small", "idqn", "batch_size", "1024", "updates come four times as often, a quarter as many at once"},
    {"small", "mixers", "batch_size", "1024",
     "simulators and learner wait for each other sooner: a quarter of the decisions may be ahead"},
    {"small", "q_learning", "num_batches_to_accumulate", "1", "decisions enter the replay sooner"},
    {"small", "mixers", "replay_batch_size", "4",
     "many updates from few sequences: 256 decisions of two agents"},
    {"small", "mixers", "replay_ratio", "4",
     "an update for every 64 new decisions; QMIX learned Platform Chain's first steps in 5 minutes, and "
     "nothing in 4 with a ratio of 1 (RECIPES.md)"},
    {"small", "mixers", "td_lambda", "0.8", "rewards reach earlier decisions of a sequence in fewer updates"},
    {"small", "mixers", "target_update_tau", "0.02",
     "runs have thousands of updates, not tens of thousands: targets 50 updates old instead of 200"},
    {"small", "idqn", "replay_batch_size", "64",
     "16 updates for every 1024 decisions, each trained on once; with this and the next three rows the "
     "return on Ammo Carrier grew three times as far (RECIPES.md)"},
    {"small", "idqn", "dqn_max_updates_per_batch", "16", "16 updates for every 1024 decisions"},
    {"small", "idqn", "target_update_tau", "0.02", "targets 50 updates old instead of 200, as the mixers'"},
    {"small", "idqn", "n_step", "5", "rewards reach earlier decisions in fewer updates"},
    {"small", "idqn", "dqn_reward_clip", "0",
     "a clip of 1 makes a stag (50) worth a hare; Huber's loss bounds what one payment can do"},
    {"small", "vdn", "learning_rate", "5e-4", "few updates; five times the published rate"},
    {"small", "qmix", "learning_rate", "2.5e-4",
     "with 5e-4 three of five runs on Platform Chain lost what they had learned within 1 M env frames, with "
     "half of it none of four, and they learned as fast (RECIPES.md)"},
    {"small", "qmix", "max_grad_norm", "0.5",
     "gradients have a norm of 0.1 to 0.4; before such a run breaks one of 8 to 200 comes, which 4 lets "
     "through tenfold (RECIPES.md)"},
    {"small", "qmix", "mixer_state_deviation", "1",
     "the encoder's features are the mixer's state, and grow without limit; the mixer's weights and gradient "
     "grow with them (RECIPES.md)"},
    {"small", "qmix", "normalize_q_values", "true",
     "targets grow from 0.7 to 20 within a run; Platform Chain and Dumb Enemies are learned better "
     "(RECIPES.md)"},
    {"small", "idqn", "learning_rate", "2e-4", "few updates; twice the published rate"},
    {"small", "qplex_d qplex_q", "learning_rate", "1e-4",
     "the published rate: one of three QPLEX runs on a small game went wrong at 3e-4 (learner/NOTES.md)"},
    {"small", "q_learning", "epsilon", "1@0..0.05@3e5",
     "the published 20 M env frames are longer than a run on two cores; so short a way leaves some "
     "exploration"},
    {"small", "q_learning", "learning_starts_decisions", "10000",
     "the published 50 000 decisions are a tenth of a run of 2 M env frames"},

    // gpu: what it has over small.
    {"gpu", "on_policy q_learning", "policy_processes", "false",
     "processes take turns on a GPU; threads of the learner share it, and weights stay there"},
    {"gpu", "on_policy", "batch_size", "4096", "a train step takes as long to start for 1 024 decisions"},
    {"gpu", "on_policy", "num_envs_per_worker", "16",
     "a forward pass of 256 rows takes 2.6 times as long as one of 64 (BENCHMARKS.md)"},
};

/// The presets whose rows hold, the last one uppermost.
std::vector<Preset> layers_of(Preset preset) {
  if (preset == Preset::kGpu) return {Preset::kSmall, Preset::kGpu};
  return {preset};
}

void append_rows(std::string_view preset, const AlgorithmName& algorithm, SettingsLayer& layer) {
  for (const RecipeRow& row : kRecipeRows)
    if (row.preset == preset && row.is_for(algorithm)) layer.values.emplace_back(row.setting, row.value);
}

constexpr std::array<std::string_view, 4> kGroups = {"all", "on_policy", "q_learning", "mixers"};

bool is_called(const AlgorithmRow& algorithm, std::string_view word) {
  if (word == "all") return true;
  if (word == "on_policy") return !algorithm.learns_q_values();
  if (word == "q_learning") return algorithm.learns_q_values();
  if (word == "mixers") return algorithm.mixes_q_values();
  return word == algorithm.name || (!algorithm.recipe_of.empty() && word == algorithm.recipe_of);
}

}  // namespace

bool RecipeRow::is_for(const AlgorithmName& algorithm) const {
  std::string_view rest = algorithms;
  while (!rest.empty()) {
    const std::size_t blank = rest.find(' ');
    if (is_called(*algorithm, rest.substr(0, blank))) return true;
    rest = blank == std::string_view::npos ? std::string_view() : rest.substr(blank + 1);
  }
  return false;
}

std::span<const std::string_view> algorithm_groups() { return kGroups; }

std::span<const RecipeRow> recipe_rows() { return kRecipeRows; }

SettingsLayer algorithm_defaults(const AlgorithmName& algorithm) {
  SettingsLayer layer{"algorithm " + algorithm.name(), {}};
  append_rows("", algorithm, layer);
  return layer;
}

SettingsLayer preset_settings(Preset preset, const AlgorithmName& algorithm) {
  SettingsLayer layer{"preset " + std::string(word_of(preset)), {}};
  for (const Preset each : layers_of(preset)) append_rows(word_of(each), algorithm, layer);
  return layer;
}

SettingsLayer qplex_preset_settings(QplexPreset preset) {
  if (preset != QplexPreset::kPaper) return {};
  return {"qplex_preset paper",
          {{"qplex_weighted_head", "true"},
           {"qplex_num_kernel", "10"},
           {"qplex_adv_hypernet_layers", "3"},
           {"qplex_state_bias", "true"}}};
}

SettingsLayer scenario_settings(const SettingsLayer& training, Preset preset,
                                const AlgorithmName& algorithm) {
  SettingsLayer chosen{training.origin, {}};
  std::vector<std::string_view> names(kGroups.begin(), kGroups.end());
  names.insert(names.end(), {algorithm->recipe_of, algorithm->name});
  for (const Preset each : layers_of(preset))
    for (const std::string_view name : names) {
      if (!is_called(*algorithm, name)) continue;
      const std::string prefix = std::string(word_of(each)) + "." + std::string(name) + ".";
      for (const auto& [key, value] : training.values)
        if (key.starts_with(prefix)) chosen.values.emplace_back(key.substr(prefix.size()), value);
    }
  return chosen;
}

}  // namespace comrad
