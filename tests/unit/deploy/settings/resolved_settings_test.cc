// What every scenario, algorithm and preset comes to, 13 x 8 x 2 of them, against tables that were typed from the
// specification of the training system (its sections are named beside the rows) and never read from the code. Every
// setting is in one of three lists: learned with (kPaper), or not (kNotLearning); a new one fails the test until it is
// put into one of them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <set>
#include <sstream>

#include "deploy/settings/merged_settings.h"
#include "rollout_buffer/settings/algorithms.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/setting.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::deploy {
namespace resolved_settings_test {

constexpr const char* kAlgorithms[] = {"ippo", "mappo", "happo", "idqn", "vdn", "qmix", "qplex_d", "qplex_q"};

/// The scenarios and their share of the team's reward for ippo and mappo (index of scenarios, section 9).
const std::map<std::string, double> kSharedReward = {
    {"stag_hunt_arena", 0}, {"rhythm_sync", 1},  {"foraging_commons", 0},      {"coop_puzzle", 1},
    {"platform_chain", 1},  {"armory_siege", 0}, {"coop_health_gathering", 0}, {"lava_pit", 1},
    {"smart_enemies", 0},   {"dumb_enemies", 0}, {"ammo_carrier", 0},          {"stealth_labyrinth", 1},
    {"lava_maze", 1}};

/// A setting and its value: one for all algorithms, or one each in the order of kAlgorithms. "-" is an empty text.
struct Row {
  const char* setting;
  const char* values;
  std::string of(size_t algorithm) const {
    std::istringstream words(values);
    std::string word, first;
    words >> first;
    if (words.str().find(' ') == std::string::npos) return first == "-" ? "" : first;
    word = first;
    for (size_t i = 0; i < algorithm; ++i) words >> word;
    return word == "-" ? "" : word;
  }
};

// shared_reward_alpha is computed in expected_text().
constexpr Row kPaper[] = {
    // 3.2 loop; 3.1: LSTM runs take 4 epochs, HAPPO a lag of 1000 (N + 1)
    {"rollout", "32"},
    {"batch_size", "4096"},
    {"num_batches_per_epoch", "1"},
    {"num_epochs", "4 4 1 1 1 1 1 1"},
    {"num_batches_to_accumulate", "2"},
    {"max_policy_lag", "1000 1000 3000 1000 1000 1000 1000 1000"},
    {"shuffle_minibatches", "false"},
    // 3.2 RL; 8: time-outs bootstrap; 2.1: normalised values and targets are clipped to +-5
    {"gamma", "0.99"},
    {"gae_lambda", "0.95"},
    {"reward", "-"},  // the scenario's own weights
    {"heads", "-"},   // and its own heads
    {"reward_scale", "1"},
    {"reward_clip", "1000"},
    {"normalize_returns", "true"},
    {"returns_clip", "5"},
    {"returns_half_life_decisions", "0"},
    {"popart", "false"},
    {"advantage_deviation_min", "0"},
    {"normalize_input", "true"},
    {"legacy_timeouts", "false"},
    // 3.2 PPO
    {"ppo_clip_ratio", "0.1"},
    {"ppo_clip_value", "0.2"},
    {"value_loss_coeff", "0.5"},
    {"exploration_loss", "symmetric_kl"},
    {"exploration_loss_coeff", "0.001"},
    {"kl_loss_coeff", "0"},
    {"early_stop_kl", "0"},
    {"with_vtrace", "false"},
    {"vtrace_rho", "1"},
    {"vtrace_c", "1"},
    // 3.2 optimiser; 2.5: the reference's mixers pass only the rate, so their epsilon is 1e-8; 3.1: HAPPO's rate decays
    {"learning_rate", "1e-4"},
    {"lr_schedule", "constant constant linear_decay constant constant constant constant constant"},
    {"lr_schedule_kl_threshold", "0.008"},
    {"lr_adaptive_min", "1e-6"},
    {"lr_adaptive_max", "1e-2"},
    {"adam_eps", "1e-6 1e-6 1e-6 1e-6 1e-8 1e-8 1e-8 1e-8"},
    {"adam_beta1", "0.9"},
    {"adam_beta2", "0.999"},
    {"max_grad_norm", "4"},
    // 3.2 model; 3.1 RNN; 2.3: HAPPO has separate networks per agent; 7 item 22: values are not tied to positions
    {"encoder", "simple"},
    {"use_rnn", "true true true false true true true true"},
    {"rnn_type", "lstm lstm gru gru gru gru gru gru"},
    {"rnn_size", "512"},
    {"rnn_num_layers", "1"},
    {"decoder_mlp_layers", "none"},
    {"q_layer_norm", "false"},
    {"policy_init_gain", "1"},
    {"share_parameters", "true true false true true true true true"},
    {"agent_id_input", "false"},
    {"critic_hidden_sizes", "512,256"},
    {"mappo_critic_view", "own_first"},
    {"critic_state", "features"},
    // 3.2 HAPPO, with the critic's core of 3.1
    {"happo_critic_rnn", "true"},
    {"happo_agent_order", "random"},
    {"happo_factor_clamp", "0"},
    // 3.2 Q, with 3.1's four updates; 7 item 18: heads explore one by one; 7 item 11: beta takes the whole run
    {"epsilon", "1@0..0.01@2e7"},
    {"epsilon_per_head", "true"},
    {"double_dqn", "true"},
    {"target_update_tau", "0.005"},
    {"target_update_interval", "1000"},
    {"n_step", "1"},
    {"td_lambda", "-1"},
    {"q_value_clamp", "100"},
    {"q_reset_every_updates", "0"},
    {"q_reset_fresh_share", "0.5"},
    {"normalize_q_values", "false"},
    {"use_huber_loss", "true"},
    {"dqn_reward_clip", "1"},
    {"team_reward", "auto auto auto sum sum sum sum sum"},
    {"learning_starts_decisions", "50000"},
    {"train_every_decisions", "4"},
    {"dqn_max_updates_per_batch", "4"},
    {"replay_ratio", "0"},
    {"replay_batch_size", "0 0 0 256 64 64 16 16"},
    {"burn_in", "0"},
    {"replay_capacity_decisions", "1e6"},
    {"per", "true true true true false false false false"},
    {"per_omega", "0.6"},
    {"per_beta_start", "0.4"},
    {"per_beta_env_frames", "0 0 0 1e8 1e8 1e8 1e8 1e8"},
    {"per_sequences", "false"},
    {"per_eta", "0.9"},
    // 3.2 mixer; 8: --qplex_preset comrad
    {"mixer", "- - - - vdn qmix dmaq dmaq_qatten"},
    {"mixer_state_deviation", "0"},
    {"qmix_embed_dim", "32"},
    {"qmix_hypernet_hidden", "64"},
    {"qplex_preset", "comrad"},
    {"qplex_embed_dim", "32"},
    {"qplex_hypernet_embed", "64"},
    {"qplex_adv_hypernet_layers", "1"},
    {"qplex_adv_hypernet_embed", "64"},
    {"qplex_num_kernel", "4"},
    {"qplex_n_head", "4"},
    {"qplex_attend_reg_coef", "0.001"},
    {"qplex_is_minus_one", "true"},
    {"qplex_weighted_head", "false"},
    {"qplex_nonlinear", "false"},
    {"qplex_state_bias", "false"},
    // 3.2 env; 1.2: no measurement vector in the benchmark; 2.10: the team's reward is the sum
    {"num_agents", "2"},
    {"env_frameskip", "4"},
    {"render_size", "128x72"},
    {"renderer", "painter"},
    {"resize", "none"},
    {"use_additional_input", "false"},
    {"shared_reward_scalarisation", "sum"},
};

/// What `small` changes of kPaper.
constexpr Row kSmall[] = {
    {"batch_size", "1024"},
    {"num_epochs", "1"},
    {"num_batches_to_accumulate", "1"},
    {"encoder", "impala impala impala simple impala impala impala impala"},
    {"rnn_type", "gru"},
    {"rnn_size", "256 256 256 512 256 256 256 256"},
    {"learning_rate", "4e-4 4e-4 4e-4 2e-4 5e-4 2.5e-4 1e-4 1e-4"},
    {"max_grad_norm", "4 4 4 4 4 0.5 4 4"},
    {"ppo_clip_ratio", "0.2 0.2 0.2 0.1 0.1 0.1 0.1 0.1"},
    {"epsilon",
     "1@0..0.01@2e7 1@0..0.01@2e7 1@0..0.01@2e7 1@0..0.05@3e5 1@0..0.05@3e5 1@0..0.05@3e5 1@0..0.05@3e5 "
     "1@0..0.05@3e5"},
    {"learning_starts_decisions", "50000 50000 50000 10000 10000 10000 10000 10000"},
    {"replay_ratio", "0 0 0 0 4 4 4 4"},
    {"td_lambda", "-1 -1 -1 -1 0.8 0.8 0.8 0.8"},
    {"target_update_tau", "0.005 0.005 0.005 0.02 0.02 0.02 0.02 0.02"},
    {"n_step", "1 1 1 5 1 1 1 1"},
    {"dqn_max_updates_per_batch", "4 4 4 16 4 4 4 4"},
    {"replay_batch_size", "0 0 0 64 4 4 4 4"},
    {"mixer_state_deviation", "0 0 0 0 0 1 0 0"},
    {"normalize_q_values", "false false false false false true false false"},
    {"dqn_reward_clip", "1 1 1 0 1 1 1 1"},
    {"adam_eps", "1e-6 1e-6 1e-6 1e-8 1e-8 1e-8 1e-8 1e-8"},
};

/// And what its scenarios change of that.
struct ScenarioRow {
  const char* scenario;
  Row row;
};
constexpr ScenarioRow kSmallScenarios[] = {
    {"ammo_carrier",
     {"exploration_loss",
      "entropy symmetric_kl symmetric_kl symmetric_kl symmetric_kl symmetric_kl symmetric_kl symmetric_kl"}},
    {"ammo_carrier",
     {"exploration_loss_coeff", "0.01@0..0.003@2600000 0.001 0.001 0.001 0.001 0.001 0.001 0.001"}},
    {"foraging_commons", {"n_step", "1"}},
    {"lava_maze",
     {"exploration_loss",
      "entropy entropy entropy symmetric_kl symmetric_kl symmetric_kl symmetric_kl symmetric_kl"}},
    {"lava_maze", {"exploration_loss_coeff", "0.004 0.004 0.004 0.001 0.001 0.001 0.001 0.001"}},
    {"lava_pit", {"gamma", "0.9995"}},
    {"rhythm_sync", {"gamma", "0.999"}},
    {"rhythm_sync", {"reward", "failed=0"}},
    {"stag_hunt_arena", {"q_value_clamp", "100 100 100 100 0 0 0 0"}},
    {"stag_hunt_arena",
     {"reward",
      "hare_kill=0@0,3@3.5e6,health_lost=0@0,-0.01@3.5e6,own_death=0@0,-2@3.5e6 "
      "hare_kill=0@0,3@3.5e6,health_lost=0@0,-0.01@3.5e6,own_death=0@0,-2@3.5e6 "
      "hare_kill=0@0,3@3.5e6,health_lost=0@0,-0.01@3.5e6,own_death=0@0,-2@3.5e6 - - - - -"}},
    {"stag_hunt_arena",
     {"exploration_loss",
      "entropy entropy entropy symmetric_kl symmetric_kl symmetric_kl symmetric_kl symmetric_kl"}},
    {"stag_hunt_arena",
     {"exploration_loss_coeff",
      "0.01@0..0.003@1e7 0.01@0..0.003@1e7 0.01@0..0.003@1e7 0.001 0.001 0.001 0.001 0.001"}},
    {"stealth_labyrinth",
     {"exploration_loss",
      "entropy entropy entropy symmetric_kl symmetric_kl symmetric_kl symmetric_kl symmetric_kl"}},
    {"stealth_labyrinth", {"exploration_loss_coeff", "0.01 0.01 0.01 0.001 0.001 0.001 0.001 0.001"}},
};

/// What changes neither what is learned from nor how: the run, its processes, memory, records, and which maps are drawn.
const std::set<std::string> kNotLearning = {"scenario",
                                            "variant",
                                            "scenario_version",
                                            "decision_limit",
                                            "algo",
                                            "preset",
                                            "experiment",
                                            "train_dir",
                                            "restart_behavior",
                                            "metrics_port",
                                            "seed",
                                            "layout_seed",
                                            "wad",
                                            "layout_pool",
                                            "layout_swap_every",
                                            "train_for_env_frames",
                                            "train_for_seconds",
                                            "device",
                                            "policy_device",
                                            "num_workers",
                                            "num_envs_per_worker",
                                            "worker_num_splits",
                                            "policy_workers",
                                            "policy_processes",
                                            "async_rl",
                                            "deterministic",
                                            "min_batch",
                                            "max_batch",
                                            "max_wait_us",
                                            "trajectory_slabs",
                                            "learner_threads",
                                            "learners",
                                            "policy_threads",
                                            "precision",
                                            "set_workers_cpu_affinity",
                                            "micro_batch_size",
                                            "replay_gb",
                                            "replay_file",
                                            "replay_compress",
                                            "save_replay",
                                            "curriculum",
                                            "seq_threshold",
                                            "seq_max_return",
                                            "seq_window",
                                            "seq_min_outcomes",
                                            "lp_p_theta",
                                            "lp_min_return",
                                            "lp_max_return",
                                            "lp_uniform_prob",
                                            "interestingness_graph_path",
                                            "omni_mastery",
                                            "plr_score_key",
                                            "plr_max_score_coef",
                                            "plr_alpha",
                                            "plr_score_transform",
                                            "plr_temperature",
                                            "plr_staleness_coef",
                                            "plr_staleness_transform",
                                            "plr_staleness_temperature",
                                            "plr_replay_schedule",
                                            "plr_replay_prob",
                                            "plr_rho",
                                            "plr_eps",
                                            "save_every_sec",
                                            "save_milestones_sec",
                                            "save_milestones_env_frames",
                                            "eval_every_env_frames",
                                            "eval_episodes",
                                            "eval_maps",
                                            "video_every_env_frames",
                                            "keep_checkpoints",
                                            "save_best_every_sec",
                                            "save_best_after_env_frames",
                                            "load_checkpoint_kind",
                                            "experiment_summaries_interval",
                                            "progress_interval",
                                            "stats_avg",
                                            "serve",
                                            "publish",
                                            "serve_workers",
                                            "serve_frame_workers",
                                            "serve_bf16_weights",
                                            "link",
                                            "hosts",
                                            "host_keys",
                                            "interface",
                                            "peers",
                                            "port_base",
                                            "link_buffer_mb",
                                            "link_datagram_bytes",
                                            "insecure_network"};

/// Setting -> value of one configuration, from the tables above.
std::map<std::string, std::string> expected_texts(const std::string& scenario, size_t algorithm,
                                                  bool is_small) {
  std::map<std::string, std::string> expected;
  for (const Row& row : kPaper) expected[row.setting] = row.of(algorithm);
  if (is_small) {
    for (const Row& row : kSmall) expected.at(row.setting) = row.of(algorithm);
    for (const ScenarioRow& own : kSmallScenarios)
      if (own.scenario == scenario) expected.at(own.row.setting) = own.row.of(algorithm);
  }
  // 2.10: sharing is for actor-critics; 7 item 17: HAPPO's joint critic needs one reward for all.
  expected["shared_reward_alpha"] = algorithm >= 3                    ? "0"
                                    : algorithm == 2                  ? "1"
                                    : kSharedReward.at(scenario) == 1 ? "1"
                                                                      : "0";
  return expected;
}

/// Numbers are compared as such: 1e-4 is 0.0001.
bool same(const std::string& a, const std::string& b) {
  char *a_end = nullptr, *b_end = nullptr;
  const double x = std::strtod(a.c_str(), &a_end), y = std::strtod(b.c_str(), &b_end);
  const bool are_numbers = !a.empty() && !b.empty() && *a_end == '\0' && *b_end == '\0';
  return are_numbers ? x == y : a == b;
}

/// describe_scenario without another process.
Expected<ScenarioDescription> from_file(const RunConfig& config) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(config.run.scenario));
  const int64_t num_agents = config.environment.num_agents;
  ScenarioDescription description;
  description.name = spec.name;
  description.env = spec.shape(num_agents == 0 ? spec.default_agents : static_cast<int>(num_agents),
                               config.environment.use_additional_input);
  description.supported_agents = spec.supported_agents;
  description.decision_limit = spec.decision_limit;
  description.ceiling = spec.ceiling;
  description.shared_reward_alpha = spec.shared_reward_alpha;
  for (const scenarios::RewardTerm& term : spec.rewards) description.rewards.push_back(term.name);
  description.training = spec.training;
  return description;
}

Expected<MergedSettings> merged(const std::string& scenario, const char* algorithm,
                                const std::string& preset) {
  const SettingsLayer typed{"command line",
                            {{"scenario", scenario}, {"algo", algorithm}, {"preset", preset}}};
  return merge_new({"", typed}, from_file, 2);
}

TEST(ResolvedSettings, AreThoseOfTheSpecificationForEveryScenarioAlgorithmAndPreset) {
  for (const auto& [scenario, alpha] : kSharedReward)
    for (size_t algorithm = 0; algorithm < std::size(kAlgorithms); ++algorithm)
      for (const char* preset : {"paper", "small"}) {
        SCOPED_TRACE(scenario + " " + kAlgorithms[algorithm] + " " + preset);
        const auto resolved = merged(scenario, kAlgorithms[algorithm], preset);
        ASSERT_TRUE(resolved) << resolved.error().message;
        const auto expected = expected_texts(scenario, algorithm, preset == std::string("small"));
        for (const auto& [setting, text] : expected) {
          const std::string is = setting_text(resolved->config, setting);
          EXPECT_TRUE(same(is, text)) << setting << " is " << is << ", must be " << text;
        }
      }
}

TEST(ResolvedSettings, EverySettingIsEitherLearnedWithOrNot) {
  const auto learned = expected_texts("lava_pit", 0, false);
  for (const SettingRow& row : setting_rows()) {
    const std::string name(row.name);
    EXPECT_NE(learned.contains(name), kNotLearning.contains(name))
        << name << " must be in one of the two lists";
  }
  EXPECT_EQ(setting_rows().size(), learned.size() + kNotLearning.size())
      << "a list names a setting that does not exist";
}

TEST(ResolvedSettings, PaperChoosesLearningValuesOnly) {
  for (const auto& [scenario, alpha] : kSharedReward)
    for (const char* algorithm : kAlgorithms) {
      const auto resolved = merged(scenario, algorithm, "paper");
      ASSERT_TRUE(resolved) << resolved.error().message;
      for (const std::string& setting : kNotLearning) {
        const std::string from = resolved->from.at(setting);
        EXPECT_TRUE(from == "built-in" || from == "command line" || from == "automatic")
            << setting << " comes from " << from;
      }
    }
}

TEST(ResolvedSettings, SmallHalvesTheEnvironmentsOfTheOnPolicyOnes) {
  for (size_t algorithm = 0; algorithm < std::size(kAlgorithms); ++algorithm) {
    const auto resolved = merged("foraging_commons", kAlgorithms[algorithm], "small");
    ASSERT_TRUE(resolved) << resolved.error().message;
    EXPECT_EQ(resolved->config.collection.num_envs_per_worker, algorithm < 3 ? 8 : 16)
        << kAlgorithms[algorithm];
  }
}

TEST(ResolvedSettings, NoScenarioIsLeftOut) {
  std::vector<std::string> names;
  for (const auto& [name, alpha] : kSharedReward) names.push_back(name);
  EXPECT_THAT(scenarios::list_scenarios(), ::testing::IsSupersetOf(names));
  EXPECT_EQ(names.size(), 13u);
  auto algorithms = algorithm_names();
  algorithms.resize(std::size(kAlgorithms));  // other tests of this program add their own behind them
  EXPECT_THAT(algorithms, ::testing::ElementsAreArray(kAlgorithms));
}

}  // namespace resolved_settings_test
}  // namespace comrad::deploy
