#include "rollout_buffer/settings/recipes.h"
#include "rollout_buffer/settings/layers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <sstream>
#include <tuple>

#include "rollout_buffer/settings/resolve.h"

namespace comrad {
namespace recipes_test {

using ::testing::HasSubstr;

RunConfig two_agents() {
  RunConfig config;
  config.environment.num_agents = 2;
  return config;
}

TEST(AlgorithmDefaults, IppoIsLstmWithFourEpochs) {
  for (const char* name : {"ippo", "IPPO", "appo", "APPO"}) {
    RunConfig config;
    ASSERT_TRUE(apply_layer(config, algorithm_defaults(name))) << name;
    EXPECT_EQ(config.network.rnn_type, RnnType::kLstm);
    EXPECT_TRUE(config.network.use_rnn);
    EXPECT_EQ(config.optimisation.num_epochs, 4);
    EXPECT_EQ(config.optimisation.batch_size, 4096);
  }
}

TEST(AlgorithmDefaults, HappoIsGruWithOneEpochLinearDecayAndSeparateNetworks) {
  RunConfig config = two_agents();
  config.run.algo = "happo";
  ASSERT_TRUE(apply_layer(config, algorithm_defaults("HAPPO")));
  EXPECT_EQ(config.network.rnn_type, RnnType::kGru);
  EXPECT_EQ(config.optimisation.num_epochs, 1);
  EXPECT_EQ(config.optimisation.lr_schedule, RateSchedule::kLinearDecay);
  EXPECT_FALSE(config.network.share_parameters);
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_EQ(config.collection.max_policy_lag, 3000);  // a version per agent and one for the critic
}

TEST(Algorithms, AnUnknownNameIsRefusedWithTheKnownOnes) {
  const Expected<const AlgorithmRow*> unknown = algorithm_named("ipo");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(unknown.error().message, HasSubstr("did you mean 'ippo'"));
  EXPECT_THAT(unknown.error().message, HasSubstr("known: ippo"));
}

TEST(Algorithms, EveryNameIsSomeRowsAlone) {
  std::set<std::string_view> names;
  for (const AlgorithmRow* row : algorithm_rows()) {
    EXPECT_TRUE(names.insert(row->name).second) << row->name;
    EXPECT_EQ(find_algorithm(row->name), row);
    for (const std::string_view other : row->other_names) {
      if (other.empty()) continue;
      EXPECT_TRUE(names.insert(other).second) << other;
      EXPECT_EQ(find_algorithm(other), row);
    }
    EXPECT_EQ(row->mixes_q_values(), !row->mixer_name.empty()) << row->name;
    EXPECT_EQ(row->learns_q_values(), row->critic == CriticKind::kNone) << row->name;
  }
}

TEST(Algorithms, AnAddedRowHasARecipeAndResolvedSettings) {
  static constexpr AlgorithmRow kRow{.name = "ippo_with_a_twist", .can_follow_kl = true, .recipe_of = "ippo"};
  add_algorithm(kRow);
  RunConfig config = two_agents();
  ASSERT_TRUE(apply_layer(config, {"test layer", {{"algo", "IPPO_with_a_twist"}}}));
  EXPECT_EQ(config.run.algo.name(), "ippo_with_a_twist");
  ASSERT_TRUE(apply_layer(config, algorithm_defaults(config.run.algo)));
  EXPECT_EQ(config.network.rnn_type, RnnType::kLstm) << "ippo's row";
  EXPECT_EQ(config.optimisation.adam_eps, 1e-6) << "the family's row";
  const SettingsLayer training{"scenario",
                               {{"small.ippo_with_a_twist.gamma", "0.9"},
                                {"small.ippo.gamma", "0.9995"},
                                {"small.ippo.rollout", "16"},
                                {"small.mappo.rollout", "8"},
                                {"paper.ippo.rollout", "64"}}};
  ASSERT_TRUE(apply_layer(config, scenario_settings(training, Preset::kSmall, config.run.algo)));
  EXPECT_EQ(config.collection.rollout, 16) << "the scenario's row for ippo";
  EXPECT_EQ(config.optimisation.gamma, 0.9) << "the scenario's row for the variant itself goes above it";
  config.on_policy.with_vtrace = true, config.optimisation.normalize_returns = false;
  const Status refused = resolve_settings(config, 2);
  ASSERT_FALSE(refused) << "the row does not say that it can";
  EXPECT_THAT(refused.error().message, HasSubstr("ippo_with_a_twist"));
  config.on_policy.with_vtrace = false;
  EXPECT_TRUE(resolve_settings(config, 2));
}

TEST(AlgorithmDefaults, ValueDecompositionIsGruOverSequencesAndIdqnFeedForward) {
  const auto resolved = [](const std::string& algo) {
    RunConfig config = two_agents();
    EXPECT_TRUE(apply_layer(config, {"test layer", {{"algo", algo}}}));
    EXPECT_TRUE(apply_layer(config, algorithm_defaults(config.run.algo))) << algo;
    const Status done = resolve_settings(config, 2);
    EXPECT_TRUE(done) << done.error().message;
    return config;
  };
  for (const char* algo : {"VDN", "qmix"}) {
    const RunConfig config = resolved(algo);
    EXPECT_EQ(config.q_learning.replay_batch_size, 64);
    EXPECT_EQ(config.network.rnn_type, RnnType::kGru);
    EXPECT_FALSE(config.replay.per);  // whole sequences are drawn uniformly
    EXPECT_EQ(config.q_learning.team_reward, TeamReward::kSum);
    EXPECT_TRUE(config.run.algo->learns_q_values() && config.run.algo->mixes_q_values());
  }
  EXPECT_EQ(resolved("QPLEX_Q").mixers.mixer, "dmaq_qatten");
  EXPECT_EQ(resolved("qplex_d").q_learning.replay_batch_size, 16);
  const RunConfig idqn = resolved("dqn");
  EXPECT_TRUE(idqn.run.algo == "idqn");
  EXPECT_FALSE(idqn.network.use_rnn);
  EXPECT_TRUE(idqn.replay.per);
  EXPECT_EQ(idqn.q_learning.replay_batch_size, 256);
  EXPECT_FALSE(idqn.run.algo->mixes_q_values());
}

TEST(AlgorithmDefaults, AdamsEpsilonIsTheAlgorithmsOwn) {
  for (const std::string& algorithm : algorithm_names()) {
    RunConfig config;
    config.optimisation.adam_eps = 1;
    ASSERT_TRUE(apply_layer(config, algorithm_defaults(algorithm)));
    const bool is_on_policy = !find_algorithm(algorithm)->learns_q_values();
    EXPECT_EQ(config.optimisation.adam_eps, is_on_policy ? 1e-6 : 1e-8) << algorithm;
  }
}

TEST(QplexPreset, ThePapersSettingsLieAboveTheAlgorithms) {
  RunConfig config = two_agents();
  EXPECT_TRUE(qplex_preset_settings(QplexPreset::kComrad).values.empty());
  ASSERT_TRUE(apply_layer(config, qplex_preset_settings(QplexPreset::kPaper)));
  EXPECT_TRUE(config.mixers.qplex_weighted_head && config.mixers.qplex_state_bias);
  EXPECT_EQ(config.mixers.qplex_num_kernel, 10);
  EXPECT_EQ(config.mixers.qplex_adv_hypernet_layers, 3);
}

TEST(RecipeRows, EveryRowNamesWhatIsKnownGivesItsReasonAndStandsOnce) {
  std::set<std::tuple<std::string_view, std::string, std::string_view>> seen;
  for (const RecipeRow& row : recipe_rows()) {
    const std::string where = std::string(row.preset) + " " + std::string(row.setting);
    EXPECT_TRUE(row.preset.empty() || row.preset == "paper" || row.preset == "small" || row.preset == "gpu")
        << where;
    EXPECT_GT(row.reason.size(), 10u) << where;
    RunConfig config;
    const Status applied = apply_layer(config, {where, {{std::string(row.setting), std::string(row.value)}}});
    EXPECT_TRUE(applied) << applied.error().message;
    int algorithms = 0;
    for (const std::string& algorithm : algorithm_names()) {
      if (!row.is_for(algorithm)) continue;
      ++algorithms;
      EXPECT_TRUE(seen.emplace(row.preset, algorithm, row.setting).second) << where << " for " << algorithm;
    }
    EXPECT_GT(algorithms, 0) << where;
    std::istringstream words{std::string(row.algorithms)};
    for (std::string word; words >> word;)
      EXPECT_TRUE(find_algorithm(word) != nullptr || word == "on_policy" || word == "q_learning" ||
                  word == "mixers")
          << where << " is for " << word;
  }
}

TEST(RecipeRows, ARowIsForWholeNamesOnly) {
  const RecipeRow row{"", "qplex_d mappo", "gamma", "0.9", ""};
  EXPECT_TRUE(row.is_for("mappo") && row.is_for("qplex_d"));
  EXPECT_FALSE(row.is_for("qplex_q") || row.is_for("ippo"));
}

TEST(PresetSettings, HoldTheRowsOfOnePresetAndAlgorithm) {
  const SettingsLayer small = preset_settings(Preset::kSmall, "APPO");
  EXPECT_EQ(small.origin, "preset small");
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, small));
  EXPECT_EQ(config.optimisation.batch_size, 1024);
  EXPECT_EQ(config.q_learning.learning_starts_decisions, RunConfig().q_learning.learning_starts_decisions)
      << "a row of the Q-learners";
  EXPECT_TRUE(preset_settings(Preset::kPaper, "ippo").values.empty())
      << "the algorithm's rows are the published ones";
  const Status unknown = apply_layer(config, {"test layer", {{"preset", "papr"}}});
  ASSERT_FALSE(unknown);
  EXPECT_THAT(unknown.error().message, HasSubstr("one of paper, small, gpu; did you mean 'paper'"));
}

TEST(PresetSettings, GpuStandsOverSmall) {
  RunConfig small, gpu;
  ASSERT_TRUE(apply_layer(small, preset_settings(Preset::kSmall, "happo")));
  const SettingsLayer layer = preset_settings(Preset::kGpu, "happo");
  EXPECT_EQ(layer.origin, "preset gpu");
  ASSERT_TRUE(apply_layer(gpu, layer));
  EXPECT_EQ(gpu.optimisation.batch_size, 4096);
  EXPECT_FALSE(gpu.collection.policy_processes);
  EXPECT_EQ(gpu.network.rnn_size, small.network.rnn_size);
  EXPECT_EQ(gpu.optimisation.num_epochs, 1);
  const SettingsLayer training{
      "scenario toy", {{"gpu.vdn.gamma", "0.7"}, {"small.vdn.gamma", "0.9"}, {"small.vdn.rollout", "16"}}};
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, scenario_settings(training, Preset::kGpu, "vdn")));
  EXPECT_EQ(config.optimisation.gamma, 0.7);
  EXPECT_EQ(config.collection.rollout, 16);
}

TEST(ScenarioSettings, AreThoseOfOnePresetAndAlgorithmWithoutTheirNames) {
  const SettingsLayer training{"scenario toy",
                               {{"small.vdn.rollout", "16"},
                                {"paper.vdn.rollout", "8"},
                                {"small.qmix.rollout", "4"},
                                {"small.vdn.gamma", "0.9"}}};
  const SettingsLayer chosen = scenario_settings(training, Preset::kSmall, "vdn");
  using Values = std::vector<std::pair<std::string, std::string>>;
  EXPECT_EQ(chosen.origin, "scenario toy");
  EXPECT_EQ(chosen.values, (Values{{"rollout", "16"}, {"gamma", "0.9"}}));
}

TEST(ScenarioSettings, AGroupIsAllItsAlgorithmsAndAnAlgorithmsOwnRowWins) {
  const SettingsLayer training{"scenario toy",
                               {{"small.qmix.gamma", "0.9"},
                                {"small.on_policy.rollout", "16"},
                                {"small.mixers.gamma", "0.95"},
                                {"small.q_learning.rollout", "8"},
                                {"small.all.gamma", "0.999"}}};
  const auto of = [&](const char* algorithm) {
    RunConfig config;
    EXPECT_TRUE(apply_layer(config, scenario_settings(training, Preset::kSmall, algorithm)));
    return std::pair(config.optimisation.gamma, config.collection.rollout);
  };
  EXPECT_EQ(of("happo"), std::pair(0.999, int64_t{16}));
  EXPECT_EQ(of("idqn"), std::pair(0.999, int64_t{8}));
  EXPECT_EQ(of("vdn"), std::pair(0.95, int64_t{8}));
  EXPECT_EQ(of("qmix"), std::pair(0.9, int64_t{8}));
  EXPECT_TRUE(scenario_settings(training, Preset::kPaper, "qmix").values.empty());
}

}  // namespace recipes_test
}  // namespace comrad
