#include "deploy/settings/merged_settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace merged_settings_test {

using ::testing::_;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsSupersetOf;
using ::testing::Not;
using ::testing::Pair;

/// A scenario whose own defaults show where they win and lose.
Expected<ScenarioDescription> fake_scenario(const RunConfig& config) {
  const std::string& name = config.run.scenario;
  const int64_t num_agents = config.environment.num_agents;
  if (name.substr(0, name.find('@')) != "two_rooms")
    return Error{ErrorCode::kBadInput, "unknown scenario '" + name + "'"};
  ScenarioDescription scenario;
  scenario.name = name;
  scenario.env.num_agents = num_agents == 0 ? 2 : static_cast<int32_t>(num_agents);
  scenario.env.measurement_count = config.environment.use_additional_input ? 5 : 0;
  scenario.supported_agents = {2, 4};
  scenario.shared_reward_alpha = 0.25;
  scenario.ceiling = 40;
  scenario.rewards = {"door_opened", "own_death"};
  scenario.training = {"scenario two_rooms",
                       {{"small.ippo.batch_size", "2048"},
                        {"small.ippo.num_epochs", "2"},
                        {"paper.ippo.num_epochs", "7"},
                        {"small.qplex_q.qmix_batch_sequences", "5"},
                        {"small.happo.layout_pool", "curriculum"},
                        {"small.happo.layout_swap_every", "1"},
                        {"small.happo.curriculum", "learning_progress"}}};
  return scenario;
}

UserSettings typed(std::vector<std::pair<std::string, std::string>> values) {
  values.insert(values.begin(), {"scenario", "two_rooms"});
  return {"", {"command line", std::move(values)}};
}

TEST(MergeNew, ALaterLayerWins) {
  const auto published = merge_new(typed({{"preset", "paper"}}), fake_scenario, 2);
  ASSERT_TRUE(published) << published.error().message;
  EXPECT_EQ(published->config.network.rnn_type, RnnType::kLstm);  // algorithm over built-in
  const auto defaults = merge_new(typed({}), fake_scenario, 2);
  ASSERT_TRUE(defaults) << defaults.error().message;
  EXPECT_EQ(defaults->config.network.rnn_size, 256);             // preset over the algorithm's 512
  EXPECT_EQ(defaults->config.network.rnn_type, RnnType::kGru);   // preset over the algorithm's lstm
  EXPECT_EQ(defaults->config.optimisation.learning_rate, 4e-4);  // preset over built-in
  EXPECT_EQ(defaults->config.optimisation.num_epochs, 2);        // scenario over the preset's 1
  EXPECT_EQ(defaults->config.optimisation.batch_size, 2048);     // scenario over the preset's 1024

  const test::ScratchFolder folder;
  UserSettings user = typed({{"batch_size", "512"}});
  user.config_file = folder.write("settings.toml", "num_epochs = 3\nbatch_size = 1024\n");
  const auto merged = merge_new(user, fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.optimisation.num_epochs, 3);    // file over scenario
  EXPECT_EQ(merged->config.optimisation.batch_size, 512);  // command line over file
}

TEST(MergeNew, AVariantIsPartOfTheScenariosName) {
  const test::ScratchFolder folder;
  const auto merged = [&](const std::string& file, std::vector<std::pair<std::string, std::string>> values) {
    UserSettings user{folder.write("settings.toml", file), {"command line", std::move(values)}};
    const auto result = merge_new(user, fake_scenario, 2);
    EXPECT_TRUE(result) << result.error().message;
    return result ? result->config.run.scenario + " " + result->config.run.variant : "";
  };
  EXPECT_EQ(merged("", {{"scenario", "two_rooms"}, {"variant", "hard"}}), "two_rooms@hard hard");
  EXPECT_EQ(merged("", {{"scenario", "two_rooms@hard"}}), "two_rooms@hard hard");
  EXPECT_EQ(merged("variant = \"hard\"", {{"scenario", "two_rooms"}}), "two_rooms@hard hard");
  EXPECT_EQ(merged("scenario = \"two_rooms@hard\"", {{"variant", "easy"}}), "two_rooms@easy easy");
  EXPECT_EQ(merged("scenario = \"two_rooms@hard\"", {{"scenario", "two_rooms@easy"}}), "two_rooms@easy easy");
  EXPECT_EQ(merged("scenario = \"two_rooms@hard\"", {{"variant", "default"}}), "two_rooms ");
  EXPECT_EQ(merged("", {{"scenario", "two_rooms@default"}}), "two_rooms ");
}

TEST(MergeNew, WeightsAreForRewardTermsThatTheScenarioHas) {
  const auto merged = merge_new(typed({{"reward", "own_death=-1.5, door_opened=2"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.environment.reward, "own_death=-1.5, door_opened=2");
  EXPECT_THAT(merge_new(typed({{"reward", "own_deth=1"}}), fake_scenario, 2).error().message,
              HasSubstr("did you mean 'own_death'"));
  for (const char* wrong : {"own_death", "own_death=", "=1", "own_death=x", "own_death=nan", "own_death=1e9"})
    EXPECT_THAT(merge_new(typed({{"reward", wrong}}), fake_scenario, 2).error().message,
                HasSubstr("NAME=WEIGHT"))
        << wrong;
}

TEST(MergeNew, ThePresetChoosesItsOwnRowsAndTheScenarios) {
  const auto paper = merge_new(typed({{"preset", "paper"}}), fake_scenario, 2);
  ASSERT_TRUE(paper) << paper.error().message;
  EXPECT_EQ(paper->config.network.rnn_type, RnnType::kLstm);
  EXPECT_EQ(paper->config.optimisation.batch_size, 4096);
  EXPECT_EQ(paper->config.optimisation.num_epochs, 7) << "the scenario's row of this preset";
  const test::ScratchFolder folder;
  UserSettings by_file = typed({});
  by_file.config_file = folder.write("settings.toml", "preset = \"paper\"\n");
  const auto same = merge_new(by_file, fake_scenario, 2);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(settings_to_toml(same->config), settings_to_toml(paper->config));
  EXPECT_EQ(same->from.at("preset"), "file");
  const auto unknown = merge_new(typed({{"preset", "papers"}}), fake_scenario, 2);
  ASSERT_FALSE(unknown);
  EXPECT_THAT(unknown.error().message, HasSubstr("did you mean 'paper'"));
}

TEST(MergeNew, ReportsTheLayerThatEachValueCameFrom) {
  const test::ScratchFolder folder;
  UserSettings user =
      typed({{"algo", "ippo"}, {"rollout", "32"}, {"micro_batch_size", "70"}, {"seed", "42"}});
  user.config_file = folder.write("settings.toml", "lr = 1e-3\nrollout = 16\n");
  const auto merged = merge_new(user, fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  const auto& from = merged->from;
  EXPECT_EQ(from.at("gamma"), "built-in");
  EXPECT_EQ(from.at("use_rnn"), "algorithm");
  EXPECT_EQ(from.at("rnn_size"), "preset");
  EXPECT_EQ(from.at("ppo_clip_ratio"), "preset");
  EXPECT_EQ(from.at("num_epochs"), "scenario");
  EXPECT_EQ(from.at("shared_reward_alpha"), "scenario");
  EXPECT_EQ(from.at("num_agents"), "scenario");
  EXPECT_EQ(from.at("learning_rate"), "file") << "under its old name";
  EXPECT_EQ(from.at("rollout"), "command line");
  EXPECT_EQ(from.at("seed"), "command line") << "typed, though it is the built-in value";
  EXPECT_EQ(from.at("num_workers"), "automatic");
  EXPECT_EQ(from.at("micro_batch_size"), "automatic") << "rounded down to 64";
  for (const SettingRow& row : setting_rows()) EXPECT_TRUE(from.contains(std::string(row.name))) << row.name;
  EXPECT_EQ(from.size(), setting_rows().size());
}

TEST(MergeNew, SharesOfRewards) {
  const auto alpha = [](std::vector<std::pair<std::string, std::string>> flags) {
    const auto merged = merge_new(typed(std::move(flags)), fake_scenario, 2);
    EXPECT_TRUE(merged) << merged.error().message;
    return merged ? merged->config.environment.shared_reward_alpha : -2;
  };
  for (const char* preset : {"paper", "small"}) {
    EXPECT_EQ(alpha({{"preset", preset}, {"algo", "ippo"}}), 0.25) << "the scenario's";
    EXPECT_EQ(alpha({{"preset", preset}, {"algo", "mappo"}}), 0.25) << "the scenario's";
    EXPECT_EQ(alpha({{"preset", preset}, {"algo", "happo"}}), 1) << "its joint critic needs one reward";
    EXPECT_EQ(alpha({{"preset", preset}, {"algo", "happo"}, {"shared_reward_alpha", "0"}}), 0) << "requested";
    EXPECT_EQ(alpha({{"preset", preset}, {"algo", "idqn"}}), 0);
    EXPECT_EQ(alpha({{"preset", preset}, {"algo", "qmix"}}), 0);
  }
}

TEST(MergeNew, QplexPresetLiesBetweenThePresetAndTheScenariosRows) {
  const auto merged = merge_new(
      typed({{"algo", "qplex"}, {"mixer", "dmaq_qatten"}, {"qplex_preset", "paper"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.run.algo, "qplex_q");
  EXPECT_EQ(merged->config.q_learning.replay_batch_size, 5);
  EXPECT_EQ(merged->config.mixers.qplex_num_kernel, 10);
  EXPECT_EQ(merged->from.at("qplex_num_kernel"), "preset");
  const auto other = merge_new(typed({{"algo", "qmix"}}), fake_scenario, 2);
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_EQ(other->config.q_learning.replay_batch_size, 4) << "small's, not the row of qplex_q";
}

TEST(MergeNew, WithoutARecurrentCoreThePresetsTdLambdaFallsAwayAndATypedOneIsRefused) {
  const auto recurrent = merge_new(typed({{"algo", "vdn"}}), fake_scenario, 2);
  ASSERT_TRUE(recurrent) << recurrent.error().message;
  EXPECT_EQ(recurrent->config.q_learning.td_lambda, 0.8);
  const auto flat = merge_new(typed({{"algo", "vdn"}, {"use_rnn", "false"}}), fake_scenario, 2);
  ASSERT_TRUE(flat) << flat.error().message;
  EXPECT_EQ(flat->config.q_learning.td_lambda, -1);
  EXPECT_EQ(flat->from.at("td_lambda"), "automatic");
  const auto asked =
      merge_new(typed({{"algo", "vdn"}, {"use_rnn", "false"}, {"td_lambda", "0.5"}}), fake_scenario, 2);
  ASSERT_FALSE(asked);
  EXPECT_THAT(asked.error().message, HasSubstr("td_lambda"));
}

TEST(MergeNew, RecipesCountInTheUnitOfTheirCoreAlone) {
  const auto size = [](std::vector<std::pair<std::string, std::string>> flags) {
    const auto merged = merge_new(typed(std::move(flags)), fake_scenario, 2);
    EXPECT_TRUE(merged) << merged.error().message;
    return merged ? merged->config.q_learning.replay_batch_size : -1;
  };
  EXPECT_EQ(size({{"algo", "vdn"}}), 4) << "sequences";
  EXPECT_EQ(size({{"algo", "vdn"}, {"use_rnn", "false"}}), 32) << "joint decisions";
  EXPECT_EQ(size({{"algo", "idqn"}}), 64) << "agent decisions";
  EXPECT_EQ(size({{"algo", "idqn"}, {"use_rnn", "true"}}), 8) << "sequences";
  EXPECT_EQ(size({{"algo", "idqn"}, {"use_rnn", "true"}, {"replay_batch_size", "6"}}), 6) << "requested";
  // The names of each unit: the one that is drawn counts, the layer it came from is that of the other setting.
  EXPECT_EQ(size({{"algo", "vdn"}, {"qmix_batch_sequences", "9"}, {"dqn_batch_decisions", "5"}}), 9);
  const auto other = merge_new(typed({{"algo", "vdn"}, {"dqn_batch_decisions", "5"}}), fake_scenario, 2);
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_EQ(other->config.q_learning.replay_batch_size, 4);
  EXPECT_EQ(other->from.at("replay_batch_size"), "preset");
}

TEST(MergeNew, TheScenariosOwnMapsFallAwayWhereTheUserChoosesSome) {
  const auto maps = [](std::vector<std::pair<std::string, std::string>> flags) {
    flags.insert(flags.begin(), {"algo", "happo"});
    const auto merged = merge_new(typed(std::move(flags)), fake_scenario, 2);
    EXPECT_TRUE(merged) << merged.error().message;
    const RunConfig config = merged ? merged->config : RunConfig();
    return std::tuple(config.environment.layout_pool, config.environment.layout_swap_every,
                      config.curriculum.curriculum);
  };
  const auto of_the_scenario = std::tuple("curriculum", 1, CurriculumKind::kLearningProgress);
  EXPECT_EQ(maps({}), of_the_scenario);
  EXPECT_EQ(maps({{"gamma", "0.9"}}), of_the_scenario);
  EXPECT_EQ(maps({{"wad", "/tmp/own.wad"}}), std::tuple("", 5, CurriculumKind::kUniform));
  EXPECT_EQ(maps({{"layout_seed", "42"}}), std::tuple("", 5, CurriculumKind::kUniform));
  EXPECT_EQ(maps({{"layout_pool", "train:8"}}), std::tuple("train:8", 5, CurriculumKind::kUniform));
  EXPECT_EQ(maps({{"layout_pool", "train:8"}, {"layout_swap_every", "2"}}),
            std::tuple("train:8", 2, CurriculumKind::kUniform));
}

TEST(MergeNew, ACommandsChangesLieBelowWhatTheUserTyped) {
  const SettingsLayer changes{"bench",
                              {{"train_for_env_frames", "1e15"}, {"num_epochs", "9"}, {"gamma", "0.5"}}};
  const auto merged = merge_new(typed({{"gamma", "0.9"}}), fake_scenario, 2, changes);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.run.train_for_env_frames, 1e15);
  EXPECT_EQ(merged->config.optimisation.num_epochs, 9);
  EXPECT_EQ(merged->from.at("num_epochs"), "bench");
  EXPECT_EQ(merged->config.optimisation.gamma, 0.9);
}

TEST(MergeNew, LeavesNoAutomaticValue) {
  const auto merged = merge_new(typed({}), fake_scenario, 3);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.environment.num_agents, 2);
  EXPECT_EQ(merged->config.environment.shared_reward_alpha, 0.25);
  EXPECT_EQ(merged->config.collection.num_workers, 3);
  EXPECT_GT(merged->config.collection.trajectory_slabs, 0);
}

TEST(MergeNew, TheTeamSizeReachesTheShape) {
  const auto merged =
      merge_new(typed({{"num_agents", "4"}, {"use_additional_input", "true"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->scenario.env.num_agents, 4);
  EXPECT_EQ(merged->scenario.env.measurement_count, 5);
}

TEST(MergeNew, NamesTheLayerOfAnUnknownKey) {
  const test::ScratchFolder folder;
  UserSettings user = typed({});
  user.config_file = folder.write("settings.toml", "batchsize = 3\n");
  const auto merged = merge_new(user, fake_scenario, 2);
  ASSERT_FALSE(merged);
  EXPECT_THAT(merged.error().message, HasSubstr(user.config_file));
  EXPECT_THAT(merged.error().message, HasSubstr("batch_size"));
}

TEST(MergeNew, PassesOnAnUnknownScenario) {
  const auto merged = merge_new({"", {"command line", {{"scenario", "nowhere"}}}}, fake_scenario, 2);
  ASSERT_FALSE(merged);
  EXPECT_THAT(merged.error().message, HasSubstr("nowhere"));
}

/// A run as it was made by merge_new.
RunConfig made_run() {
  auto merged = merge_new(typed({{"num_workers", "2"}}), fake_scenario, 2);
  return merged ? merged->config : RunConfig();
}

TEST(MergeNew, KeepsTheExplicitValueOfAWorkedOutSetting) {
  const auto merged = merge_new(typed({{"batch_size", "1000"}, {"gamma", "0.9"}}), fake_scenario, 3);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.optimisation.batch_size, 960);
  EXPECT_THAT(merged->explicit_values,
              IsSupersetOf({Pair("num_workers", "0"), Pair("batch_size", "1000"), Pair("num_agents", "0"),
                            Pair("shared_reward_alpha", "-1.0"), Pair("trajectory_slabs", "0")}));
  EXPECT_THAT(merged->explicit_values, Not(Contains(Pair("gamma", _))));
}

TEST(MergeNew, TakesTheSettingsOfARunsConfigAndNotWhatWasWorkedOutForIt) {
  UserSettings user = typed({{"batch_size", "1000"}, {"gamma", "0.9"}});
  const auto old = merge_new(user, fake_scenario, 3);
  ASSERT_TRUE(old) << old.error().message;
  RunConfig run = old->config;
  run.run.experiment = "old";
  run.environment.wad = "/old/layouts/two_rooms_42.wad";
  auto explicit_values = old->explicit_values;
  explicit_values.insert(explicit_values.end(), {{"experiment", ""}, {"wad", ""}});
  const test::ScratchFolder folder;
  user = typed({{"seed", "7"}, {"num_agents", "4"}});
  user.config_file = folder.write("config.toml", settings_to_toml(run, explicit_values));

  const auto merged = merge_new(user, fake_scenario, 5);
  ASSERT_TRUE(merged) << merged.error().message;
  const RunConfig& config = merged->config;
  EXPECT_EQ(config.optimisation.gamma, 0.9);
  EXPECT_EQ(config.collection.num_workers, 5) << "this machine's";
  EXPECT_EQ(config.optimisation.batch_size, 896) << "1000 for four agents";
  EXPECT_EQ(config.run.experiment, "");
  EXPECT_EQ(config.environment.wad, "");

  // The run itself reads what was worked out.
  const auto workers = load_run_config(user.config_file);
  ASSERT_TRUE(workers) << workers.error().message;
  EXPECT_EQ(workers->collection.num_workers, 3);
  EXPECT_EQ(workers->environment.wad, "/old/layouts/two_rooms_42.wad");
}

TEST(MergeOntoRun, ItsOwnConfigAsTheUsersFileChangesNothing) {
  const auto made = merge_new(typed({{"algo", "qmix"}, {"batch_size", "1000"}}), fake_scenario, 2);
  ASSERT_TRUE(made) << made.error().message;
  const test::ScratchFolder folder;
  UserSettings user;
  user.config_file = folder.write("config.toml", settings_to_toml(made->config, made->explicit_values));
  const auto merged = merge_onto_run(made->config, user, fake_scenario, 8);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(settings_to_toml(merged->config), settings_to_toml(made->config));
}

TEST(MergeOntoRun, KeepsTheRunsSettingsUnlessTyped) {
  RunConfig run = made_run();
  run.optimisation.learning_rate = 0.5;
  const auto merged = merge_onto_run(run, typed({{"gamma", "0.9"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.optimisation.learning_rate, 0.5);
  EXPECT_EQ(merged->config.optimisation.gamma, 0.9);
  EXPECT_EQ(merged->config.optimisation.num_epochs, 2);
}

TEST(MergeOntoRun, RefusesToChangeWhatShapesTheNetwork) {
  const auto merged = merge_onto_run(made_run(), typed({{"rnn_size", "64"}}), fake_scenario, 2);
  ASSERT_FALSE(merged);
  EXPECT_EQ(merged.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(merged.error().message, HasSubstr("--rnn_size=64: the run was made with 256"));
}

TEST(MergeOntoRun, AnEncodersFileIsTheRunsCopyWhereItsBytesAreEqual) {
  const test::ScratchFolder folder;
  const std::string typed_file = folder.write("vit.pt", "module"),
                    other = folder.write("other.pt", "another");
  RunConfig run = merge_new(typed({{"encoder", typed_file}}), fake_scenario, 2)->config;
  EXPECT_FALSE(run.network.normalize_input);
  run.network.encoder = folder.write("run/encoder.pt", "module");
  const auto same = merge_onto_run(run, typed({{"encoder", typed_file}}), fake_scenario, 2);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(same->config.network.encoder, run.network.encoder);
  const auto changed = merge_onto_run(run, typed({{"encoder", other}}), fake_scenario, 2);
  ASSERT_FALSE(changed);
  EXPECT_THAT(changed.error().message, HasSubstr("other.pt: the run was made with"));
}

TEST(MergeNew, ACoreInOneWordIsWhereItsSettingsComeFrom) {
  const auto merged = merge_new(typed({{"core", "gru 64"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  for (const char* name : {"use_rnn", "rnn_type", "rnn_size", "rnn_num_layers"})
    EXPECT_EQ(merged->from.at(name), "command line") << name;
}

TEST(MergeOntoRun, ARunOfAnotherVersionOfTheScenarioIsRefused) {
  const auto made = merge_new(typed({}), fake_scenario, 2);
  EXPECT_EQ(made->config.environment.scenario_version, 1);
  const auto changed = [](const RunConfig& config) {
    Expected<ScenarioDescription> scenario = fake_scenario(config);
    if (scenario) scenario->version = 2;
    return scenario;
  };
  EXPECT_EQ(merge_new(typed({}), changed, 2)->config.environment.scenario_version, 2);
  const auto resumed = merge_onto_run(made->config, {}, changed, 2);
  ASSERT_FALSE(resumed);
  EXPECT_THAT(resumed.error().message, HasSubstr("two_rooms is at version 2"));
}

TEST(MergeOntoRun, AnotherPresetIsAnErrorAndNeverAnotherValue) {
  RunConfig run = made_run();
  run.optimisation.learning_rate = 0.5;
  const auto other = merge_onto_run(run, typed({{"preset", "paper"}}), fake_scenario, 2);
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("--preset=paper: the run was made with small; leave it out"));
  const auto same = merge_onto_run(run, typed({{"preset", "small"}, {"gamma", "0.9"}}), fake_scenario, 2);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(same->config.optimisation.learning_rate, 0.5);
  EXPECT_EQ(same->from.at("learning_rate"), "run");
  EXPECT_EQ(same->from.at("gamma"), "command line");
}

TEST(MergeOntoRun, ATeamSizeOfTheScenarioMeansTheRunsOne) {
  const auto merged = merge_onto_run(made_run(), typed({{"num_agents", "0"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.environment.num_agents, 2);
}

TEST(MergeOntoRun, SizesTheArenaAnewWhenItsPartsChange) {
  const RunConfig run = made_run();
  const auto larger = merge_onto_run(run, typed({{"num_workers", "8"}}), fake_scenario, 2);
  ASSERT_TRUE(larger) << larger.error().message;
  EXPECT_GT(larger->config.collection.trajectory_slabs, run.collection.trajectory_slabs);
  const auto fixed =
      merge_onto_run(run, typed({{"num_workers", "8"}, {"trajectory_slabs", "999"}}), fake_scenario, 2);
  ASSERT_TRUE(fixed) << fixed.error().message;
  EXPECT_EQ(fixed->config.collection.trajectory_slabs, 999);
}

TEST(SettingText, WritesEveryTypeAsConfigTomlDoes) {
  RunConfig config;
  EXPECT_EQ(setting_text(config, "rnn_type"), "gru");
  EXPECT_EQ(setting_text(config, "rollout"), "32");
  EXPECT_EQ(setting_text(config, "use_rnn"), "true");
  EXPECT_EQ(setting_text(config, "gamma"), "0.99");
  EXPECT_EQ(setting_text(config, "no_such_setting"), "");
}

TEST(MergeNew, CurriculaMeasureAgainstEachMapsOwnCeilingUnlessAScoreIsNamed) {
  const auto merged =
      merge_new(typed({{"layout_pool", "p"}, {"curriculum", "sequential"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.curriculum.seq_max_return, 0);
  EXPECT_EQ(merged->config.curriculum.lp_max_return, 0);
  const auto own = merge_new(typed({{"layout_pool", "p"}, {"lp_max_return", "7"}}), fake_scenario, 2);
  ASSERT_TRUE(own);
  EXPECT_EQ(own->config.curriculum.lp_max_return, 7);
}

TEST(MergeOntoRun, TheCurriculumStays) {
  const auto merged = merge_new(typed({{"layout_pool", "p"}, {"curriculum", "plr"}}), fake_scenario, 2);
  ASSERT_TRUE(merged) << merged.error().message;
  const auto other =
      merge_onto_run(merged->config, {"", {"command line", {{"curriculum", "uniform"}}}}, fake_scenario, 2);
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("the run was made with plr"));
}

}  // namespace merged_settings_test
}  // namespace comrad::deploy
