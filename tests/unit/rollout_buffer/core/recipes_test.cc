#include "rollout_buffer/core/recipes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <tuple>

namespace comrad {
namespace {

using ::testing::HasSubstr;

RunConfig two_agents() {
  RunConfig config;
  config.num_agents = 2;
  return config;
}

TEST(AlgorithmDefaults, IppoIsLstmWithFourEpochs) {
  for (const char* name : {"ippo", "IPPO", "appo", "APPO"}) {
    RunConfig config;
    const Expected<SettingsLayer> defaults = algorithm_defaults(name);
    ASSERT_TRUE(defaults) << name;
    ASSERT_TRUE(apply_layer(config, *defaults));
    EXPECT_EQ(config.rnn_type, "lstm");
    EXPECT_TRUE(config.use_rnn);
    EXPECT_EQ(config.num_epochs, 4);
    EXPECT_EQ(config.batch_size, 4096);
  }
}

TEST(AlgorithmDefaults, HappoIsGruWithOneEpochLinearDecayAndNetworksOfItsOwn) {
  RunConfig config = two_agents();
  const Expected<SettingsLayer> defaults = algorithm_defaults("HAPPO");
  ASSERT_TRUE(defaults);
  config.algo = "happo";
  ASSERT_TRUE(apply_layer(config, *defaults));
  EXPECT_EQ(config.rnn_type, "gru");
  EXPECT_EQ(config.num_epochs, 1);
  EXPECT_EQ(config.lr_schedule, "linear_decay");
  EXPECT_FALSE(config.share_parameters);
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_EQ(config.max_policy_lag, 3000);  // a version per agent and one for the critic
  EXPECT_EQ(recurrent_state_count(config), 2 * 512);
  config.happo_critic_rnn = false;
  EXPECT_EQ(recurrent_state_count(config), 512);
}

TEST(AlgorithmDefaults, AnUnknownAlgorithmNamesTheKnownOnes) {
  const Expected<SettingsLayer> unknown = algorithm_defaults("ipo");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(unknown.error().message, HasSubstr("did you mean 'ippo'"));
  EXPECT_THAT(unknown.error().message, HasSubstr("known: ippo"));
}

TEST(AlgorithmDefaults, ValueDecompositionIsGruOverSequencesAndIdqnFeedForward) {
  const auto resolved = [](const std::string& algo) {
    RunConfig config = two_agents();
    EXPECT_TRUE(apply_layer(config, {"test layer", {{"algo", algo}}}));
    EXPECT_TRUE(apply_layer(config, *algorithm_defaults(config.algo))) << algo;
    const Status done = resolve_settings(config, 2);
    EXPECT_TRUE(done) << done.error().message;
    return config;
  };
  for (const char* algo : {"VDN", "qmix"}) {
    const RunConfig config = resolved(algo);
    EXPECT_EQ(config.qmix_sequence_batch_size, 64);
    EXPECT_EQ(config.rnn_type, "gru");
    EXPECT_FALSE(config.per);  // whole sequences are drawn uniformly
    EXPECT_EQ(config.team_reward, "sum");
    EXPECT_TRUE(learns_q_values(config) && mixes_q_values(config));
  }
  EXPECT_EQ(resolved("QPLEX_Q").mixer, "dmaq_qatten");
  EXPECT_EQ(resolved("qplex_d").qmix_sequence_batch_size, 16);
  const RunConfig idqn = resolved("dqn");
  EXPECT_EQ(idqn.algo, "idqn");
  EXPECT_FALSE(idqn.use_rnn);
  EXPECT_TRUE(idqn.per);
  EXPECT_EQ(idqn.dqn_batch_size, 256);
  EXPECT_FALSE(mixes_q_values(idqn));
}

TEST(AlgorithmDefaults, AdamsEpsilonIsTheAlgorithmsOwn) {
  for (const std::string& algorithm : algorithm_names()) {
    RunConfig config;
    config.adam_eps = 1;
    ASSERT_TRUE(apply_layer(config, *algorithm_defaults(algorithm)));
    const bool is_on_policy = algorithm == "ippo" || algorithm == "mappo" || algorithm == "happo";
    EXPECT_EQ(config.adam_eps, is_on_policy ? 1e-6 : 1e-8) << algorithm;
  }
}

TEST(QplexPreset, ThePapersSettingsLieAboveTheAlgorithms) {
  RunConfig config = two_agents();
  EXPECT_TRUE(qplex_preset_settings("comrad").values.empty());
  ASSERT_TRUE(apply_layer(config, qplex_preset_settings("paper")));
  EXPECT_TRUE(config.qplex_weighted_head && config.qplex_state_bias);
  EXPECT_EQ(config.qplex_num_kernel, 10);
  EXPECT_EQ(config.qplex_adv_hypernet_layers, 3);
}

TEST(RecipeRows, EveryRowNamesWhatIsKnownGivesItsReasonAndStandsOnce) {
  std::set<std::tuple<std::string_view, std::string, std::string_view>> seen;
  for (const RecipeRow& row : recipe_rows()) {
    const std::string where = std::string(row.preset) + " " + std::string(row.setting);
    EXPECT_TRUE(row.preset.empty() || row.preset == "paper" || row.preset == "small") << where;
    EXPECT_GT(row.reason.size(), 10u) << where;
    RunConfig config;
    const Status applied = apply_layer(config, {where, {{std::string(row.setting), std::string(row.value)}}});
    EXPECT_TRUE(applied) << applied.error().message;
    std::string words;
    for (const std::string& algorithm : algorithm_names()) {
      if (!row.is_for(algorithm)) continue;
      words += (words.empty() ? "" : " ") + algorithm;
      EXPECT_TRUE(seen.emplace(row.preset, algorithm, row.setting).second) << where << " for " << algorithm;
    }
    EXPECT_EQ(words, row.algorithms) << where << ": unknown algorithms, or in another order than everywhere";
  }
}

TEST(RecipeRows, ARowIsForWholeNamesOnly) {
  const RecipeRow row{"", "qplex_d mappo", "gamma", "0.9", ""};
  EXPECT_TRUE(row.is_for("mappo") && row.is_for("qplex_d"));
  EXPECT_FALSE(row.is_for("ppo") || row.is_for("qplex") || row.is_for(""));
}

TEST(PresetSettings, HoldTheRowsOfOnePresetAndAlgorithm) {
  const auto small = preset_settings("small", "APPO");
  ASSERT_TRUE(small) << small.error().message;
  EXPECT_EQ(small->origin, "preset small");
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, *small));
  EXPECT_EQ(config.batch_size, 1024);
  EXPECT_EQ(config.learning_starts, RunConfig().learning_starts) << "a row of the Q-learners";
  const auto paper = preset_settings("paper", "ippo");
  ASSERT_TRUE(paper);
  EXPECT_TRUE(paper->values.empty()) << "the algorithm's rows are the published ones";
  const auto unknown = preset_settings("papr", "ippo");
  ASSERT_FALSE(unknown);
  EXPECT_THAT(unknown.error().message, HasSubstr("unknown preset 'papr'; did you mean 'paper'"));
}

TEST(ScenarioSettings, AreThoseOfOnePresetAndAlgorithmWithoutTheirNames) {
  const SettingsLayer training{"scenario toy",
                               {{"small.vdn.rollout", "16"},
                                {"paper.vdn.rollout", "8"},
                                {"small.qmix.rollout", "4"},
                                {"small.vdn.gamma", "0.9"}}};
  const SettingsLayer chosen = scenario_settings(training, "small", "vdn");
  using Values = std::vector<std::pair<std::string, std::string>>;
  EXPECT_EQ(chosen.origin, "scenario toy");
  EXPECT_EQ(chosen.values, (Values{{"rollout", "16"}, {"gamma", "0.9"}}));
}

}  // namespace
}  // namespace comrad
