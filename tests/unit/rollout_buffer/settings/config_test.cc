// Layers, limits, TOML and "auto": what becomes of what users write.
#include "rollout_buffer/settings/setting.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <set>

#include "rollout_buffer/core/cpu_features.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/core/toml_text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "tests/support/scratch_folder.h"

namespace comrad {
namespace config_test {

using ::testing::HasSubstr;

SettingsLayer layer(std::vector<std::pair<std::string, std::string>> values) {
  return {"test layer", std::move(values)};
}

RunConfig two_agents() {
  RunConfig config;
  config.environment.num_agents = 2;
  return config;
}

std::string resolve_error(RunConfig config, int cores = 2) {
  const Status status = resolve_settings(config, cores);
  return status ? "no error" : status.error().message;
}

TEST(ApplyLayer, ALaterLayerWinsAndOthersStay) {
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, layer({{"batch_size", "2048"}, {"gamma", "0.9"}})));
  ASSERT_TRUE(apply_layer(config, layer({{"batch_size", "1024"}})));
  EXPECT_EQ(config.optimisation.batch_size, 1024);
  EXPECT_EQ(config.optimisation.gamma, 0.9);
  EXPECT_EQ(config.collection.rollout, 32);
}

TEST(ApplyLayer, IntegersAcceptExponents) {
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, layer({{"max_batch", "1e3"}, {"stats_avg", "200.0"}, {"seed", "+7"}})));
  EXPECT_EQ(config.collection.max_batch, 1000);
  EXPECT_EQ(config.run.stats_avg, 200);
  EXPECT_EQ(config.run.seed, 7);
  ASSERT_TRUE(apply_layer(config, layer({{"seed", "9007199254740993"}})));
  EXPECT_EQ(config.run.seed, 9007199254740993) << "a whole number takes no detour over a double";
}

TEST(ApplyLayer, BooleansAcceptTheSpellingsOfPythonAndToml) {
  RunConfig config;
  for (const char* yes : {"true", "True", "1", "TRUE"}) {
    config.collection.deterministic = false;
    ASSERT_TRUE(apply_layer(config, layer({{"deterministic", yes}}))) << yes;
    EXPECT_TRUE(config.collection.deterministic) << yes;
  }
  for (const char* no : {"false", "False", "0"}) {
    ASSERT_TRUE(apply_layer(config, layer({{"use_rnn", no}}))) << no;
    EXPECT_FALSE(config.network.use_rnn) << no;
  }
}

TEST(ApplyLayer, OldNamesReachTheirSettings) {
  RunConfig config;
  ASSERT_TRUE(apply_layer(
      config,
      layer({{"env", "stag_hunt_arena"}, {"lr", "3e-4"}, {"serial_mode", "True"}, {"algo", "APPO"}})));
  EXPECT_EQ(config.run.scenario, "stag_hunt_arena");
  EXPECT_EQ(config.optimisation.learning_rate, 3e-4);
  EXPECT_TRUE(config.collection.deterministic);
  EXPECT_EQ(config.run.algo.name(), "ippo");
}

TEST(ApplyLayer, AnUnknownKeyNamesTheNearestKnownOneAndItsLayer) {
  RunConfig config;
  const Status status = apply_layer(config, layer({{"bacth_size", "1"}}));
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(status.error().message, HasSubstr("test layer: unknown setting 'bacth_size'"));
  EXPECT_THAT(status.error().message, HasSubstr("did you mean 'batch_size'"));
  const Status far = apply_layer(config, layer({{"zzzzzzzzzzzz", "1"}}));
  ASSERT_FALSE(far);
  EXPECT_THAT(far.error().message, Not(HasSubstr("did you mean")));
}

TEST(ApplyLayer, AValueOfTheWrongTypeIsRefused) {
  RunConfig config;
  for (const auto& [key, text] : std::vector<std::pair<std::string, std::string>>{{"seed", "four"},
                                                                                  {"seed", ""},
                                                                                  {"seed", "1.5"},
                                                                                  {"seed", "1e300"},
                                                                                  {"gamma", "0.9x"},
                                                                                  {"gamma", "nan"},
                                                                                  {"gamma", "inf"},
                                                                                  {"use_rnn", "maybe"}}) {
    const Status status = apply_layer(config, layer({{key, text}}));
    ASSERT_FALSE(status) << key << " = " << text;
    EXPECT_THAT(status.error().message, HasSubstr(key + " is '" + text + "'"));
  }
  EXPECT_EQ(config.run.seed, 42);
  EXPECT_EQ(config.optimisation.gamma, 0.99);
}

TEST(ApplyLayer, AWordThatNoSettingHasIsRefusedWithTheValidOnes) {
  RunConfig config;
  for (const auto& [key, text, known] : std::vector<std::array<std::string, 3>>{
           {"algo", "ddpg", "ippo, mappo"},
           {"restart_behavior", "maybe", "one of resume, restart, overwrite"},
           {"rnn_type", "rnn", "one of gru, lstm"},
           {"precision", "fp16", "one of fp32, bf16"},
           {"curriculum", "hardest", "learning_progress"},
           {"plr_score_transform", "cube", "eps_greedy"},
           {"plr_score_key", "loss", "mean_value_l1"}}) {
    const Status status = apply_layer(config, layer({{key, text}}));
    ASSERT_FALSE(status) << key << " = " << text;
    EXPECT_THAT(status.error().message, HasSubstr("test layer: " + key + " is '" + text + "'"));
    EXPECT_THAT(status.error().message, HasSubstr(known));
  }
  ASSERT_TRUE(apply_layer(config, layer({{"rnn_type", "LSTM"}, {"curriculum", "Plr"}})));
  EXPECT_EQ(config.network.rnn_type, RnnType::kLstm);
  EXPECT_EQ(config.curriculum.curriculum, CurriculumKind::kPlr);
}

TEST(SettingRows, NoNameIsUsedTwiceAndEveryDefaultIsWithinItsLimits) {
  std::set<std::string_view> names;
  const RunConfig defaults;
  for (const SettingRow& row : setting_rows()) {
    EXPECT_TRUE(names.insert(row.name).second) << row.name;
    for (const std::string_view old : row.traits.old_names) {
      EXPECT_TRUE(old.empty() || names.insert(old).second) << old;
    }
    EXPECT_NE(row.help, "") << row.name;
    RunConfig copy;
    EXPECT_TRUE(row.assign(copy, row.text(defaults))) << row.name << ": a default reads back";
    if (row.name != "num_agents") {  // 0 until the scenario is known
      EXPECT_TRUE(row.holds(defaults, row.limits)) << row.name;
    }
  }
}

class SettingsToml : public ::testing::Test {
 protected:
  const test::ScratchFolder folder_;
};

TEST_F(SettingsToml, ChangedRowsAloneReadBackWithoutLoss) {
  RunConfig config;
  EXPECT_EQ(changed_settings_to_toml(config),
            "scenario = \"coop_health_gathering\"\nalgo = \"ippo\"\nseed = 42\nscenario_version = 0\n"
            "renderer = \"painter\"\n");
  config.run.algo = "vdn";
  config.environment.scenario_version = 2;
  config.optimisation.learning_rate = 0.1 + 0.2;
  config.collection.async_rl = false;
  const std::string rows = changed_settings_to_toml(config);
  EXPECT_EQ(std::ranges::count(rows, '\n'), 7);
  const Expected<RunConfig> read = load_run_config(folder_.write("changed.toml", rows));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(settings_to_toml(*read), settings_to_toml(config));
  const Expected<RunConfig> old = load_run_config(folder_.write("old.toml", "seed = 7\n"));
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_EQ(old->environment.scenario_version, 1);
  EXPECT_EQ(old->environment.renderer, RendererKind::kOsmesa);
}

TEST_F(SettingsToml, TheWrittenDocumentReadsBackWithoutLoss) {
  RunConfig config;
  config.run.experiment = "quoted \"name\"\\ with\ttab and \xC3\xA9";
  config.optimisation.learning_rate = 0.1 + 0.2;
  config.run.train_for_env_frames = 1.25e8;
  config.optimisation.adam_eps = 1e-300;
  config.run.seed = 9007199254740993;
  config.collection.async_rl = false;
  const Expected<RunConfig> read =
      load_run_config(folder_.write("round_trip.toml", settings_to_toml(config)));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(settings_to_toml(*read), settings_to_toml(config));
  EXPECT_EQ(read->run.experiment, config.run.experiment);
  EXPECT_EQ(read->optimisation.learning_rate, config.optimisation.learning_rate);
  EXPECT_EQ(read->run.seed, config.run.seed);
}

TEST_F(SettingsToml, BadDocumentsSayWhere) {
  const Expected<SettingsLayer> syntax =
      read_settings_toml(folder_.write("syntax.toml", "seed = 1\nrollout = = 3\n"));
  ASSERT_FALSE(syntax);
  EXPECT_EQ(syntax.error().code, ErrorCode::kBadFormat);
  EXPECT_THAT(syntax.error().message, HasSubstr("syntax.toml:2:"));
  const Expected<SettingsLayer> table =
      read_settings_toml(folder_.write("table.toml", "seed = 1\n[learner]\nrollout = 3\n"));
  ASSERT_FALSE(table);
  EXPECT_THAT(table.error().message, HasSubstr("table.toml:2:"));
  EXPECT_THAT(table.error().message, HasSubstr("'learner'"));
  const Expected<SettingsLayer> absent = read_settings_toml("/nonexistent/settings.toml");
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error().code, ErrorCode::kNotFound);
  EXPECT_FALSE(load_run_config(folder_.write("unknown.toml", "sede = 1\n")));
}

TEST_F(SettingsToml, SeededNoiseNeverCrashesTheReader) {
  const std::string valid = settings_to_toml(RunConfig{});
  for (uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng(seed);
    std::string text = valid.substr(0, rng.below(static_cast<uint32_t>(valid.size())));
    for (int flip = 0; flip < 8 && !text.empty(); ++flip)
      text[rng.below(static_cast<uint32_t>(text.size()))] = static_cast<char>(rng.below(256));
    const Expected<RunConfig> read = load_run_config(folder_.write("noise.toml", text));
    if (!read) {
      EXPECT_NE(read.error().message, "") << "seed " << seed;
    }
  }
}

TEST_F(SettingsToml, ARunsFileHoldsExplicitValuesBesideResolvedOnes) {
  RunConfig config = two_agents();
  config.collection.num_workers = 6;
  const std::string path = folder_.write(
      "config.toml", settings_to_toml(config, {{"num_workers", "0"}, {"wad", ""}, {"team_reward", "auto"}}));
  const auto read = read_settings_toml(path);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_THAT(read->explicit_values,
              ::testing::UnorderedElementsAre(::testing::Pair("num_workers", "0"), ::testing::Pair("wad", ""),
                                              ::testing::Pair("team_reward", "auto")));
  EXPECT_EQ(read->values.size(), setting_rows().size());
  EXPECT_EQ(load_run_config(path)->collection.num_workers, 6);
  const auto old = read_settings_toml(folder_.write("old.toml", "seed = 3\n[asked_for]\nnum_workers = 0\n"));
  ASSERT_TRUE(old) << "a run's file of an older version";
  EXPECT_THAT(old->explicit_values, ::testing::ElementsAre(::testing::Pair("num_workers", "0")));
  const auto other_table = read_settings_toml(folder_.write("other.toml", "[others]\nnum_workers = 0\n"));
  ASSERT_FALSE(other_table);
  EXPECT_THAT(other_table.error().message, HasSubstr("'others'"));
  const auto deep = read_settings_toml(folder_.write("deep.toml", "[explicit]\nseed = [1]\n"));
  ASSERT_FALSE(deep);
  EXPECT_THAT(deep.error().message, HasSubstr("deep.toml:2:"));
}

TEST(ApplyLayer, AMixerChoosesAmongQmixAndQplex) {
  const auto algo_of = [](std::vector<std::pair<std::string, std::string>> values) {
    RunConfig config = two_agents();
    EXPECT_TRUE(apply_layer(config, layer(std::move(values))));
    return config.run.algo.name();
  };
  EXPECT_EQ(algo_of({{"algo", "QPLEX"}}), "qplex_d");
  EXPECT_EQ(algo_of({{"algo", "qplex"}, {"mixer", "dmaq"}}), "qplex_d");
  EXPECT_EQ(algo_of({{"mixer", "DMAQ_QATTEN"}, {"algo", "QPLEX"}}), "qplex_q");
  EXPECT_EQ(algo_of({{"algo", "qmix"}, {"mixer", "vdn"}}), "vdn");
  EXPECT_EQ(algo_of({{"algo", "mappo"}, {"mixer", "qmix"}}), "mappo");
  RunConfig config = two_agents();
  ASSERT_TRUE(apply_layer(config, layer({{"algo", "mappo"}, {"mixer", "qmix"}})));
  EXPECT_THAT(resolve_error(config), HasSubstr("mixer is qmix"));
}

TEST(ResolveSettings, QLearningSettingsThatExcludeEachOtherAreRefused) {
  const auto expect = [](void (*spoil)(RunConfig&), const char* message) {
    RunConfig config = two_agents();
    config.run.algo = "vdn";
    EXPECT_TRUE(resolve_settings(config, 2));
    config = two_agents();
    config.run.algo = "vdn";
    spoil(config);
    EXPECT_THAT(resolve_error(config), HasSubstr(message));
  };
  expect([](RunConfig& c) { c.environment.num_agents = 1; }, "use idqn for one");
  expect([](RunConfig& c) { c.network.rnn_type = RnnType::kLstm; }, "vdn's core is a gru");
  expect([](RunConfig& c) { c.q_learning.td_lambda = 0.8, c.network.use_rnn = false; }, "use --n_step");
  expect([](RunConfig& c) { c.q_learning.n_step = 64; }, "n_step is 64");
  expect([](RunConfig& c) { c.q_learning.n_step = Schedule::line(64, 3, 1e6); }, "n_step is 64@0..3@1e6");
  expect([](RunConfig& c) { c.q_learning.n_step = Schedule::line(10, 2.5, 1e6); }, "a whole number");
  expect([](RunConfig& c) { c.q_learning.burn_in = 32; }, "burn_in is 32");
  expect([](RunConfig& c) { c.optimisation.lr_schedule = RateSchedule::kKlAdaptiveEpoch; },
         "constant or linear_decay");
  expect([](RunConfig& c) { c.replay.replay_gb = -1; }, "replay_gb is -1");
  expect([](RunConfig& c) { c.q_learning.target_update_tau = 0; }, "target_update_tau is 0");
  expect([](RunConfig& c) { c.mixers.qplex_adv_hypernet_layers = 4; }, "qplex_adv_hypernet_layers is 4");
  expect(
      [](RunConfig& c) {
        c.curriculum.curriculum = CurriculumKind::kPlr, c.environment.layout_pool = "train:4";
      },
      "estimates no advantages");
}

TEST(ResolveSettings, AutoFitsASmallHost) {
  RunConfig config = two_agents();
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_EQ(config.collection.num_workers, 2);
  EXPECT_EQ(config.collection.learner_threads, 2);
  EXPECT_GE(config.collection.min_batch, 1);
  EXPECT_GE(config.collection.max_batch, config.collection.min_batch);
  // One slab in the making for each of 32 environments; two batches of 4096 / (32 x 2) = 64 slabs may wait.
  EXPECT_EQ(config.collection.trajectory_slabs, 32 + 2 * 64);
}

TEST(ResolveSettings, TwoCoresTakeOneSplitAndWholeBatches) {
  const auto splits_and_batch = [](int cores, const std::function<void(RunConfig&)>& change = {}) {
    RunConfig config = two_agents();
    if (change) change(config);
    EXPECT_TRUE(resolve_settings(config, cores));
    return std::pair(config.collection.worker_num_splits, config.collection.min_batch);
  };
  EXPECT_EQ(splits_and_batch(2), std::pair(int64_t{1}, int64_t{32})) << "2 simulators of 16";
  EXPECT_EQ(splits_and_batch(1), std::pair(int64_t{1}, int64_t{16}));
  EXPECT_EQ(splits_and_batch(4), std::pair(int64_t{2}, int64_t{8})) << "a group";
  EXPECT_EQ(splits_and_batch(2, [](RunConfig& c) { c.collection.worker_num_splits = 2; }),
            std::pair(int64_t{2}, int64_t{8}));
  EXPECT_EQ(splits_and_batch(2, [](RunConfig& c) { c.collection.max_batch = 20; }),
            std::pair(int64_t{1}, int64_t{20}));
  EXPECT_EQ(splits_and_batch(2, [](RunConfig& c) { c.collection.policy_workers = 3; }).first, 2)
      << "so many want more groups";
  EXPECT_EQ(splits_and_batch(2, [](RunConfig& c) { c.collection.device = "cuda"; }).first, 2)
      << "what waits for a GPU needs no core";
}

TEST(ResolveSettings, LearnerThreadsGrowWithTheHostAndStopAtSixteen) {
  for (const auto& [cores, threads] :
       std::vector<std::pair<int, int>>{{1, 1}, {2, 2}, {4, 2}, {8, 4}, {64, 16}}) {
    RunConfig config = two_agents();
    ASSERT_TRUE(resolve_settings(config, cores));
    EXPECT_EQ(config.collection.learner_threads, threads) << cores << " cores";
    EXPECT_EQ(config.collection.num_workers, cores);
  }
}

TEST(ResolveSettings, OnePolicyWorkerServesFiveCoresOrAGpu) {
  const auto policy_workers = [](int cores, const std::string& device, const std::string& policy_device = "",
                                 int64_t num_workers = 0, bool policy_processes = true) {
    RunConfig config = two_agents();
    config.collection.policy_processes = policy_processes;
    config.collection.device = device;
    config.collection.policy_device = policy_device;
    config.collection.num_workers = num_workers;
    EXPECT_TRUE(resolve_settings(config, cores));
    return config.collection.policy_workers;
  };
  EXPECT_EQ(policy_workers(2, "cpu"), 1);
  EXPECT_EQ(policy_workers(8, "cpu"), 1);
  EXPECT_EQ(policy_workers(16, "cpu"), 3);
  EXPECT_EQ(policy_workers(64, "cpu"), 12);
  EXPECT_EQ(policy_workers(64, "cpu", "", /*num_workers=*/1), 2) << "no more than groups of environments";
  EXPECT_EQ(policy_workers(16, "cuda"), 1);
  EXPECT_EQ(policy_workers(16, "cpu", "gpu"), 1) << "Sample Factory's word for cuda";
  EXPECT_EQ(policy_workers(16, "cuda", "cuda:1,cuda:2,cuda:3"), 3) << "one on each";
  EXPECT_EQ(policy_workers(16, "cuda", "cpu"), 3);
  EXPECT_EQ(policy_workers(16, "cuda", "", 0, /*policy_processes=*/false), 2)
      << "threads, which do not take turns";
  EXPECT_EQ(policy_workers(16, "cpu", "", 0, false), 3);
}

TEST(ResolveSettings, ResolvingTwiceChangesNothing) {
  for (const bool deterministic : {false, true}) {
    RunConfig config = two_agents();
    config.collection.deterministic = deterministic;
    ASSERT_TRUE(resolve_settings(config, 3));
    const std::string once = settings_to_toml(config);
    ASSERT_TRUE(resolve_settings(config, 3));
    EXPECT_EQ(settings_to_toml(config), once);
  }
}

TEST(ResolveSettings, BatchSizeIsRoundedDownToWholeTrajectories) {
  RunConfig config = two_agents();
  config.environment.num_agents = 3;
  config.optimisation.batch_size = 1000;
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_EQ(config.optimisation.batch_size, 960);
  config.optimisation.batch_size = 95;
  EXPECT_THAT(resolve_error(config), HasSubstr("batch_size is 95"));
  EXPECT_THAT(resolve_error(config), HasSubstr("= 96"));
}

TEST(ResolveSettings, NumAgentsMustBeKnownByThen) {
  RunConfig config;
  EXPECT_THAT(resolve_error(config), HasSubstr("num_agents is 0"));
}

TEST(ResolveSettings, DeterministicRunsInLockStepOnEvenBatches) {
  RunConfig config = two_agents();
  config.collection.deterministic = true;
  config.collection.num_workers = 2;
  config.collection.num_envs_per_worker = 6;
  config.optimisation.batch_size = 5 * 64;  // 12 trajectories do not divide by 5, but by 4
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_FALSE(config.collection.async_rl);
  EXPECT_EQ(config.optimisation.batch_size, 4 * 64);
  EXPECT_GE(config.collection.trajectory_slabs, 2 * 12);
  EXPECT_EQ(config.collection.num_workers * config.collection.num_envs_per_worker *
                config.collection.rollout * config.environment.num_agents % config.optimisation.batch_size,
            0);
}

TEST(ResolveSettings, DeterministicNamesTheFixWhereBatchesCannotComeOutEven) {
  RunConfig config = two_agents();
  config.collection.deterministic = true;
  config.collection.num_workers = 1;
  config.collection.num_envs_per_worker = 31;
  config.optimisation.batch_size = 16 * 64;
  EXPECT_THAT(resolve_error(config), HasSubstr("--batch_size 1984"));
  config.collection.num_envs_per_worker = 16;
  config.optimisation.num_batches_per_epoch = 3;
  EXPECT_THAT(resolve_error(config), HasSubstr("num_batches_per_epoch"));
}

TEST(ResolveSettings, LearnersShareBatchesAndCoresOrSayWhatDoesNotDivide) {
  RunConfig config = two_agents();
  config.collection.learners = 4;
  ASSERT_TRUE(resolve_settings(config, 16));
  EXPECT_EQ(config.collection.learner_threads, 2) << "of eight that one learner would have";
  config = two_agents();
  config.collection.learners = 16;
  ASSERT_TRUE(resolve_settings(config, 4));
  EXPECT_EQ(config.collection.learner_threads, 1);

  const auto refused = [](void (*spoil)(RunConfig&)) {
    RunConfig wrong = two_agents();
    wrong.collection.learners = 3;
    spoil(wrong);
    return resolve_error(wrong);
  };
  EXPECT_THAT(
      refused([](RunConfig& c) { c.run.algo = "qmix"; }),
      HasSubstr("learners is 3; an update's 8 sequences are not divided by it without a remainder; set "
                "--replay_batch_size 9"));
  EXPECT_THAT(refused([](RunConfig& c) { c.run.algo = "qmix", c.network.use_rnn = false; }),
              HasSubstr("32 decisions are not divided by it without a remainder; set "
                        "--replay_batch_size 33"));
  EXPECT_THAT(
      refused([](RunConfig& c) { c.run.algo = "idqn", c.network.use_rnn = false; }),
      HasSubstr("256 decisions are not divided by it without a remainder; set --replay_batch_size 258"));
  EXPECT_THAT(
      refused([](RunConfig& c) {
        c.run.algo = "idqn", c.network.use_rnn = false;
        c.network.agent_id_input = true;  // decisions of both agents are drawn
      }),
      HasSubstr("128 decisions are not divided by it without a remainder; set --replay_batch_size 258"));
  EXPECT_THAT(refused([](RunConfig& c) {
                c.run.algo = "vdn", c.q_learning.replay_batch_size = 9;
                c.collection.num_workers = 1, c.collection.num_envs_per_worker = 2;
              }),
              HasSubstr("trajectories of some environments, and there are 2; raise --num_workers"));
  // What comes in by single trajectories need not be divided; what lock step takes in at a time must be.
  const auto vdn_of_three = [](RunConfig& c) {
    c.run.algo = "vdn", c.q_learning.replay_batch_size = 9;
    c.collection.learners = 3;
  };
  config = two_agents();
  vdn_of_three(config);
  EXPECT_TRUE(resolve_settings(config, 4));
  config = two_agents();
  vdn_of_three(config);
  config.collection.async_rl = false;
  EXPECT_THAT(resolve_error(config), HasSubstr("a batch of 64 trajectories"));
  EXPECT_THAT(refused([](RunConfig&) {}), HasSubstr("a batch of 64 trajectories"));
  EXPECT_THAT(refused([](RunConfig&) {}), HasSubstr("set --batch_size 4224"));
  EXPECT_THAT(refused([](RunConfig& c) {
                c.optimisation.batch_size = 9 * 64;
                c.optimisation.num_batches_per_epoch = 2;
                c.collection.learners = 6;
              }),
              HasSubstr("each has 3 trajectories of a batch, which num_batches_per_epoch 2 does not"));
  EXPECT_THAT(refused([](RunConfig& c) {
                c.optimisation.batch_size = 9 * 64;
                c.collection.num_workers = 1, c.collection.num_envs_per_worker = 24;
                c.collection.async_rl = false;
              }),
              HasSubstr("lock step cuts the trajectories of 24 environments"));
}

TEST(ResolveSettings, EveryRangeErrorNamesTheSettingAndItsValue) {
  const auto expect = [](void (*spoil)(RunConfig&), const char* message) {
    RunConfig config = two_agents();
    spoil(config);
    EXPECT_THAT(resolve_error(config), HasSubstr(message));
  };
  expect([](RunConfig& c) { c.environment.num_agents = 9; }, "num_agents is 9; it must be between 1 and 8");
  expect([](RunConfig& c) { c.collection.device = "tpu"; }, "device is tpu");
  expect([](RunConfig& c) { c.collection.device = "cuda:"; }, "device is cuda:");
  expect([](RunConfig& c) { c.collection.policy_device = "cuda:0,tpu"; }, "policy_device is cuda:0,tpu");
  expect([](RunConfig& c) { c.collection.policy_processes = false, c.collection.learners = 2; },
         "policy_processes is off with 2 learners");
  expect([](RunConfig& c) { c.collection.policy_processes = false, c.collection.policy_device = "cuda:1"; },
         "policy_device is cuda:1 with policy_processes off");
  expect([](RunConfig& c) { c.collection.worker_num_splits = 3; }, "worker_num_splits is 3");
  expect([](RunConfig& c) { c.collection.policy_workers = 64; }, "policy_workers is 64");
  expect([](RunConfig& c) { c.environment.render_size = "160x120"; }, "render_size is 160x120");
  expect(
      [](RunConfig& c) {
        c.environment.render_size = "big";
        c.environment.resize = Resize::kArea;
      },
      "render_size is big");
  expect([](RunConfig& c) { c.optimisation.gamma = 1.5; }, "gamma is 1.5");
  expect([](RunConfig& c) { c.optimisation.lr_adaptive_max = 1e-9; }, "lr_adaptive_max");
  expect([](RunConfig& c) { c.collection.trajectory_slabs = 3; }, "trajectory_slabs is 3");
  expect([](RunConfig& c) { c.collection.min_batch = 8, c.collection.max_batch = 4; }, "max_batch is 4");
  expect([](RunConfig& c) { c.run.experiment = "../elsewhere"; }, "experiment is ../elsewhere");
  expect([](RunConfig& c) { c.environment.shared_reward_alpha = -0.5; }, "shared_reward_alpha");
}

TEST(ResolveSettings, AutomaticPrecisionIsWhatTheMachineMultiplies) {
  RunConfig config = two_agents();
  config.collection.precision = Precision::kAuto;
  ASSERT_TRUE(resolve_settings(config, 4));
  EXPECT_EQ(config.collection.precision, cpu_multiplies_bf16() ? Precision::kBf16 : Precision::kFp32);
  config.collection.precision = Precision::kAuto;
  config.collection.device = "cuda:1";
  ASSERT_TRUE(resolve_settings(config, 4));
  EXPECT_EQ(config.collection.precision, Precision::kBf16);
}

TEST(PolicyDevice, IsTheRunsOrOneOfTheListInTurn) {
  RunConfig config;
  config.collection.device = "cuda:0";
  EXPECT_EQ(policy_device(config, 3), "cuda:0");
  config.collection.policy_device = "cuda:1,gpu,cpu";
  EXPECT_EQ(policy_device(config, 0), "cuda:1");
  EXPECT_EQ(policy_device(config, 1), "cuda");
  EXPECT_EQ(policy_device(config, 2), "cpu");
  EXPECT_EQ(policy_device(config, 3), "cuda:1");
}

TEST(ResolveSettings, OnPolicySettingsThatExcludeEachOtherAreRefused) {
  const auto expect = [](void (*spoil)(RunConfig&), const char* message) {
    RunConfig config = two_agents();
    config.run.algo = "happo";
    config.network.share_parameters = false;
    EXPECT_TRUE(resolve_settings(config, 2));
    config = two_agents();
    spoil(config);
    EXPECT_THAT(resolve_error(config), HasSubstr(message));
  };
  expect([](RunConfig& c) { c.on_policy.with_vtrace = true; }, "normalize_returns");
  expect([](RunConfig& c) { c.run.algo = "happo"; }, "share_parameters is on");
  expect(
      [](RunConfig& c) {
        c.run.algo = "happo", c.network.share_parameters = false, c.on_policy.with_vtrace = true;
      },
      "GAE");
  expect(
      [](RunConfig& c) {
        c.run.algo = "happo", c.network.share_parameters = false,
        c.optimisation.lr_schedule = RateSchedule::kKlAdaptiveEpoch;
      },
      "lr_schedule is kl_adaptive_epoch");
  expect([](RunConfig& c) { c.network.agent_id_input = true, c.network.share_parameters = false; },
         "agent_id_input");
  expect([](RunConfig& c) { c.network.critic_hidden_sizes = "512,,256"; }, "critic_hidden_sizes is 512,,256");
  expect([](RunConfig& c) { c.network.decoder_mlp_layers = "0"; }, "decoder_mlp_layers is 0");
  expect([](RunConfig& c) { c.on_policy.happo_factor_clamp = 0.5; }, "happo_factor_clamp is 0.5");
}

TEST(ParseWidths, AcceptsCommasAndBlanksAndRefusesTheRest) {
  EXPECT_EQ(*parse_widths("512,256"), (std::vector<int64_t>{512, 256}));
  EXPECT_EQ(*parse_widths(" 64 32  16 "), (std::vector<int64_t>{64, 32, 16}));
  EXPECT_EQ(*parse_widths("8, 9"), (std::vector<int64_t>{8, 9}));
  EXPECT_TRUE(parse_widths("none")->empty());
  EXPECT_TRUE(parse_widths("")->empty());
  for (const char* text : {"a", "512,", ",512", "-1", "9000", "1,,2", "1.5", "1 2 3 4 5 6 7 8 9", "none,1"})
    EXPECT_FALSE(parse_widths(text)) << text;
}

TEST(ResolveSettings, AFailedCheckLeavesTheSettingsAlone) {
  RunConfig config = two_agents();
  config.optimisation.batch_size = 1;
  const std::string before = settings_to_toml(config);
  EXPECT_FALSE(resolve_settings(config, 2));
  EXPECT_EQ(settings_to_toml(config), before);
}

TEST(DataDir, TheEnvironmentWinsOverTheBuild) {
  const char* given = std::getenv("COMRAD_HOME");
  const std::string before = given == nullptr ? "" : given;
  setenv("COMRAD_HOME", "/some/where", 1);
  EXPECT_EQ(data_dir(), "/some/where");
  unsetenv("COMRAD_HOME");
  EXPECT_EQ(data_dir(), COMRAD_SOURCE_DIR);
  if (given != nullptr) setenv("COMRAD_HOME", before.c_str(), 1);
}

TEST(TomlHeaders, AHeaderWithoutANameIsAnErrorBeforeTheParserMeetsIt) {
  for (const char* text : {"[=]", "a = 1\n [[\x1e name]]", "[\n]", "\xC2\xA0[+]"}) {
    const Status checked = check_toml_text(text, "file.toml");
    ASSERT_FALSE(checked) << text;
    EXPECT_TRUE(checked.error().message.starts_with("file.toml:")) << checked.error().message;
  }
  EXPECT_TRUE(check_toml_text("a = [1, [2], []]\n[b]\n[[ c ]]\n['d']\n[\"e\"]\nx = \"[=\"\n[", "file.toml"));
}

TEST(Resolve, APoolAndACurriculumAreChecked) {
  const auto error = [](const std::function<void(RunConfig&)>& change) {
    RunConfig config = two_agents();
    config.environment.layout_pool = "pool";
    change(config);
    return resolve_error(config);
  };
  EXPECT_EQ(error([](RunConfig& c) { c.curriculum.curriculum = CurriculumKind::kPlr; }), "no error");
  EXPECT_THAT(error([](RunConfig& c) { c.environment.wad = "one.wad"; }),
              HasSubstr("--wad names the one map"));
  EXPECT_THAT(error([](RunConfig& c) { c.environment.layout_swap_every = 0; }),
              HasSubstr("layout_swap_every is 0"));
  EXPECT_THAT(error([](RunConfig& c) {
                c.curriculum.curriculum = CurriculumKind::kOmni, c.environment.layout_pool.clear();
              }),
              HasSubstr("--layout_pool"));
  EXPECT_THAT(error([](RunConfig& c) { c.curriculum.lp_min_return = 5, c.curriculum.lp_max_return = 4; }),
              HasSubstr("lp_max_return"));
  EXPECT_THAT(error([](RunConfig& c) { c.curriculum.seq_threshold = 1.5; }), HasSubstr("seq_threshold"));
  EXPECT_THAT(error([](RunConfig& c) { c.curriculum.plr_temperature = 0; }), HasSubstr("plr_temperature"));
  EXPECT_THAT(error([](RunConfig& c) { c.curriculum.interestingness_graph_path = "g.json"; }),
              HasSubstr("omni"));
}

TEST(ApplyLayer, ThePoolsOldNamesAreKnown) {
  RunConfig config;
  ASSERT_TRUE(
      apply_layer(config, layer({{"wad_batch", "p"}, {"wad_swap_every", "1"}, {"wad_curriculum", "plr"}})));
  EXPECT_EQ(config.environment.layout_pool, "p");
  EXPECT_EQ(config.environment.layout_swap_every, 1);
  EXPECT_EQ(config.curriculum.curriculum, CurriculumKind::kPlr);
}

TEST(Settings, EveryRealHasBounds) {
  int reals = 0;
  for (const SettingRow& row : setting_rows()) {
    if (row.kind != SettingKind::kReal) continue;
    ++reals;
    for (const char* absurd : {"1e300", "-1e300"}) {
      RunConfig config = two_agents();
      ASSERT_TRUE(apply_layer(config, layer({{std::string(row.name), absurd}}))) << row.name;
      const Status checked = resolve_settings(config, 2);
      ASSERT_FALSE(checked) << row.name << " " << absurd;
      EXPECT_THAT(checked.error().message, HasSubstr(std::string(row.name)));
    }
  }
  EXPECT_GE(reals, 60);
}

TEST(Settings, TextThatIsNoUtf8IsRefused) {
  RunConfig config = two_agents();
  config.run.experiment = "caf\xE9";
  const Status checked = resolve_settings(config, 2);
  ASSERT_FALSE(checked);
  EXPECT_THAT(checked.error().message, HasSubstr("experiment"));
  config.run.experiment = "caf\xC3\xA9";
  EXPECT_TRUE(resolve_settings(config, 2));
}

TEST(Settings, KeysOfThousandsOfPartsAreRefusedBeforeTheyAreParsed) {
  std::string deep = "a", numbers;
  for (int i = 0; i < 100'000; ++i) deep += ".a";
  for (int i = 0; i < 1000; ++i) numbers += "0.5, ";
  for (const std::string& text : {deep + " = 1\n", "[" + deep + "]\n", "x = {" + deep + " = 1}\n",
                                  "s = \"\"\"\n.\"\"\"\n" + deep + " = 1\n"}) {
    const Status checked = check_toml_text(text, "file.toml");
    ASSERT_FALSE(checked);
    EXPECT_THAT(checked.error().message, HasSubstr("a key of more than 64 parts"));
    EXPECT_THAT(checked.error().message, ::testing::StartsWith("file.toml:"));
  }
  const std::string dots(1000, '.');
  EXPECT_TRUE(check_toml_text(
      "a = \"" + dots + "\" # " + dots + "\nb = '''" + dots + "\n" + dots + "'''\nc = [" + numbers + "]\n",
      "file.toml"));
}

TEST(Settings, AFileThatNeverEndsIsNotReadWhole) {
  for (const char* path : {"/dev/zero", "/proc"}) {
    const auto read = read_settings_toml(path);
    ASSERT_FALSE(read) << path;
    EXPECT_THAT(read.error().message, HasSubstr(path));
  }
}

TEST(Settings, RandomTomlIsReadOrRefusedWithItsPlace) {
  const test::ScratchFolder folder;
  const uint64_t seed = 20261123;
  Rng rng(seed);
  const std::vector<std::string> parts = {
      "a", ".",   "=",  "[",  "]",      "{",    "}",
      ",", "\n",  "\"", "'",  "\"\"\"", "'''",  "#",
      "1", "0.5", " ",  "\\", "seed",   "true", ".a.a.a.a.a.a.a.a.a.a.a.a.a.a"};
  int read = 0;
  for (int round = 0; round < 3000; ++round) {
    std::string text;
    for (uint32_t i = rng.below(200); i > 0; --i) {
      const std::string& part = parts[rng.below(static_cast<uint32_t>(parts.size()))];
      for (uint32_t times = rng.below(8) == 0 ? rng.below(100) : 1; times > 0; --times) text += part;
    }
    const auto layer = read_settings_toml(folder.write("random.toml", text));
    read += layer.has_value();
    if (!layer) {
      EXPECT_THAT(layer.error().message, HasSubstr("random.toml")) << "seed " << seed << " round " << round;
    }
  }
  EXPECT_GT(read, 0) << "an empty text is one";
}

// The size of a replay's batch was a setting for each unit, and config.toml of a run had all of them.
TEST(OldRuns, DrawTheBatchesThatTheyDrew) {
  const test::ScratchFolder folder;
  const std::string sizes =
      "dqn_batch_decisions = 64\nqmix_batch_joint_decisions = 33\nqmix_batch_sequences = 9\n";
  for (const auto& [run, size] : {std::pair("algo = \"qmix\"\nuse_rnn = true\n", 9),
                                  {"algo = \"vdn\"\nuse_rnn = false\n", 33},
                                  {"algo = \"idqn\"\nuse_rnn = false\n", 64},
                                  {"algo = \"idqn\"\nuse_rnn = true\n", 9},
                                  {"algo = \"ippo\"\nuse_rnn = true\n", 0}}) {
    const std::string path =
        folder.write("config.toml", run + sizes + "[explicit]\ndqn_batch_decisions = 0\n");
    const Expected<RunConfig> config = load_run_config(path);
    ASSERT_TRUE(config) << config.error().message;
    EXPECT_EQ(config->q_learning.replay_batch_size, size) << run;
  }
  // Those of the runs that the repository keeps, and those that later ones name.
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(COMRAD_SOURCE_DIR "/scenarios/results")) {
    const std::string path = entry.path().string() + "/config.toml";
    if (!std::filesystem::exists(path)) continue;
    const Expected<RunConfig> config = load_run_config(path);
    ASSERT_TRUE(config) << config.error().message;
    if (!config->run.algo->learns_q_values()) continue;
    ++count;
    const Expected<SettingsLayer> layer = read_settings_toml(path);
    ASSERT_TRUE(layer);
    const std::string_view old_name =
        config->network.use_rnn ? "qmix_batch_sequences" : "dqn_batch_decisions";
    const auto kept = std::ranges::find_if(layer->values, [&](const SettingValues::value_type& value) {
      return value.first == old_name || value.first == "replay_batch_size";
    });
    ASSERT_NE(kept, layer->values.end()) << path << " has neither " << old_name << " nor replay_batch_size";
    EXPECT_EQ(std::to_string(config->q_learning.replay_batch_size), kept->second) << path;
  }
  EXPECT_GT(count, 20);
}

}  // namespace config_test
}  // namespace comrad
