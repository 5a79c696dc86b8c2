#include "rollout_buffer/settings/applies_when.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {
namespace applies_when_test {

/// Whether `setting` counts in a run with these settings over the built-in ones.
bool applies(const char* setting, std::vector<std::pair<std::string, std::string>> values) {
  RunConfig config;
  config.environment.num_agents = 2;
  const Status set = apply_layer(config, {"test", std::move(values)});
  EXPECT_TRUE(set) << set.error().message;
  const Status resolved = resolve_settings(config, 2);
  EXPECT_TRUE(resolved) << resolved.error().message;
  return find_setting(setting)->applies(config);
}

TEST(AppliesWhen, TheFamilyOfTheAlgorithmDecides) {
  EXPECT_FALSE(applies("n_step", {{"algo", "ippo"}}));
  EXPECT_TRUE(applies("n_step", {{"algo", "vdn"}}));
  EXPECT_TRUE(applies("ppo_clip_ratio", {{"algo", "happo"}, {"share_parameters", "false"}}));
  EXPECT_FALSE(applies("ppo_clip_ratio", {{"algo", "idqn"}, {"use_rnn", "false"}}));
  EXPECT_FALSE(applies("replay_gb", {{"algo", "mappo"}}));
  EXPECT_TRUE(applies("replay_gb", {{"algo", "qmix"}}));
}

TEST(AppliesWhen, OneAlgorithmMayBeTheOnlyOne) {
  EXPECT_TRUE(applies("mappo_critic_view", {{"algo", "mappo"}}));
  EXPECT_FALSE(applies("mappo_critic_view", {{"algo", "ippo"}}));
  EXPECT_FALSE(applies("qmix_embed_dim", {{"algo", "vdn"}}));
  EXPECT_TRUE(applies("qplex_num_kernel", {{"algo", "qplex_d"}}));
  EXPECT_FALSE(applies("qplex_n_head", {{"algo", "qplex_d"}})) << "attention is qplex_q's";
  EXPECT_TRUE(applies("qplex_n_head", {{"algo", "qplex_q"}}));
  EXPECT_FALSE(applies("q_value_clamp", {{"algo", "idqn"}, {"use_rnn", "false"}}));
}

TEST(AppliesWhen, AnotherSettingMayDecide) {
  EXPECT_FALSE(applies("rnn_size", {{"algo", "ippo"}, {"use_rnn", "false"}}));
  EXPECT_FALSE(applies("per_omega", {{"algo", "vdn"}})) << "sequences have no priorities unless requested";
  EXPECT_TRUE(applies("per_omega", {{"algo", "vdn"}, {"per_sequences", "true"}}));
  EXPECT_TRUE(applies("per_omega", {{"algo", "idqn"}, {"use_rnn", "false"}}));
  EXPECT_FALSE(applies("per_omega", {{"algo", "idqn"}, {"use_rnn", "false"}, {"per", "false"}}));
  EXPECT_FALSE(applies("n_step", {{"algo", "vdn"}, {"td_lambda", "0.8"}}));
  EXPECT_FALSE(applies("q_layer_norm", {{"algo", "ippo"}}));
  EXPECT_FALSE(applies("q_reset_fresh_share", {{"algo", "vdn"}}));
  EXPECT_TRUE(applies("q_reset_fresh_share", {{"algo", "vdn"}, {"q_reset_every_updates", "9"}}));
  EXPECT_FALSE(applies("train_every_decisions", {{"algo", "vdn"}, {"replay_ratio", "4"}}));
  EXPECT_FALSE(applies("plr_alpha", {{"layout_pool", "train:10"}}));
  EXPECT_TRUE(applies("plr_alpha", {{"layout_pool", "train:10"}, {"curriculum", "plr"}}));
  EXPECT_FALSE(applies("layout_seed", {{"layout_pool", "train:10"}}));
}

TEST(AppliesWhen, EverySettingStatesWhereItAppliesAndEachDoesSomewhere) {
  const std::vector<std::pair<std::string, std::string>> algorithms[] = {
      {{"algo", "ippo"}, {"with_vtrace", "true"}, {"normalize_returns", "false"}},
      {{"algo", "mappo"}, {"lr_schedule", "kl_adaptive_epoch"}, {"wad", "a.wad"}},
      {{"algo", "happo"}, {"share_parameters", "false"}, {"shared_reward_alpha", "1"}},
      {{"algo", "ippo"}, {"layout_pool", "train:9"}, {"curriculum", "sequential"}},
      {{"algo", "ippo"}, {"layout_pool", "train:9"}, {"curriculum", "omni"}},
      {{"algo", "ippo"}, {"layout_pool", "train:9"}, {"curriculum", "plr"}},
      {{"algo", "ippo"}, {"serve", "true"}},
      {{"algo", "idqn"}, {"use_rnn", "false"}, {"target_update_tau", "1"}},
      {{"algo", "qmix"}, {"per_sequences", "true"}},
      {{"algo", "vdn"}, {"use_rnn", "false"}, {"q_reset_every_updates", "1000"}},
      {{"algo", "qplex_q"}, {"qplex_adv_hypernet_layers", "2"}}};
  for (const SettingRow& row : setting_rows()) {
    ASSERT_NE(row.traits.applies_when.holds, nullptr) << row.name;
    bool somewhere = false;
    for (const auto& values : algorithms) somewhere |= applies(std::string(row.name).c_str(), values);
    EXPECT_TRUE(somewhere) << row.name << " applies with " << row.traits.applies_when.words;
  }
}

TEST(Units, TheHelpOfEveryNumberStatesIts) {
  // Amounts, and what numbers without a unit are.
  const std::regex unit(
      "env frames|agent decisions|joint decisions|decisions|sequences|trajector|optimizer "
      "steps|versions|seconds|"
      "episodes|tics|environments|agents|processes|threads|groups|batches|minibatches|passes|slabs|gigabytes|"
      "files|"
      "units|deviations|layers|nats|L2|reward|score|seed|factor|share|fraction|probability|rate|exponent|"
      "weight|epsilon|"
      "number|port|MB|bytes|"
      "temperature|ratio|in units|inference");
  for (const SettingRow& row : setting_rows()) {
    if (row.kind != SettingKind::kInt && row.kind != SettingKind::kReal) continue;
    EXPECT_TRUE(std::regex_search(row.help.begin(), row.help.end(), unit)) << row.name << ": " << row.help;
  }
}

TEST(Units, NamesThatCouldMeanTwoOfThemEndInTheirs) {
  for (const SettingRow& row : setting_rows()) {
    const std::string name(row.name);
    EXPECT_FALSE(name.ends_with("_steps") || name.ends_with("_starts")) << name;
    EXPECT_EQ(name.ends_with("_frames"), name.ends_with("_env_frames")) << name;
    for (const auto& [end, unit] : {std::pair("_env_frames", "env frames"), {"_decisions", "decisions"}}) {
      if (!name.ends_with(end)) continue;
      EXPECT_NE(row.help.find(unit), std::string_view::npos) << name;
    }
  }
}

TEST(Units, TheOldNamesStillSetTheNewOnes) {
  const std::pair<const char*, const char*> names[] = {
      {"train_for_env_steps", "train_for_env_frames"},   {"per_beta_frames", "per_beta_env_frames"},
      {"save_best_after", "save_best_after_env_frames"}, {"learning_starts", "learning_starts_decisions"},
      {"train_frequency", "train_every_decisions"},      {"replay_buffer_size", "replay_capacity_decisions"}};
  for (const auto& [old_name, name] : names) {
    RunConfig config;
    ASSERT_TRUE(apply_layer(config, {"command line", {{old_name, "123"}}})) << old_name;
    EXPECT_EQ(std::stod(setting_text(config, name)), 123) << old_name;
  }
}

TEST(Units, TheOldSizesOfAReplaysBatchCountWhereTheirUnitIsDrawn) {
  const std::pair<const char*, const char*> runs[] = {{"qmix", "true"}, {"qmix", "false"}, {"idqn", "false"}};
  const std::pair<const char*, const char*> names[] = {
      {"qmix_batch_sequences", "qmix_sequence_batch_size"},
      {"qmix_batch_joint_decisions", "qmix_buffer_batch_size"},
      {"dqn_batch_decisions", "dqn_batch_size"}};
  for (std::size_t run = 0; run < std::size(runs); ++run)
    for (std::size_t unit = 0; unit < std::size(names); ++unit)
      for (const char* name : {names[unit].first, names[unit].second}) {
        RunConfig config;
        // The name comes first: the whole layer decides which run it is.
        ASSERT_TRUE(apply_layer(
            config,
            {"command line", {{name, "123"}, {"algo", runs[run].first}, {"use_rnn", runs[run].second}}}));
        EXPECT_EQ(config.q_learning.replay_batch_size, run == unit ? 123 : 0)
            << name << " of " << runs[run].first << " with use_rnn " << runs[run].second;
        EXPECT_FALSE(apply_layer(config, {"command line", {{name, "many"}}})) << name;
      }
}

}  // namespace applies_when_test
}  // namespace comrad
