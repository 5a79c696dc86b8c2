#include "deploy/settings/start_notes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace start_notes_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(FlagsWithoutEffect, AreNamedWithWhatTheyCountWith) {
  RunConfig config;
  config.run.algo = "ippo";
  EXPECT_THAT(flags_without_effect(config, {"command line", {{"n_step", "3"}, {"gamma", "0.9"}}}),
              ElementsAre(AllOf(HasSubstr("--n_step 3 does nothing"), HasSubstr("algo ippo"),
                                HasSubstr("applies with Q-learning"))));
  config.run.algo = "vdn";
  config.replay.per = false;  // as resolve_settings leaves it with a recurrent core
  EXPECT_THAT(flags_without_effect(config, {"command line", {{"n_step", "3"}, {"per_omega", "0.9"}}}),
              ElementsAre(AllOf(HasSubstr("--per_omega 0.9 does nothing"), HasSubstr("per_sequences"))));
  EXPECT_THAT(flags_without_effect(config, {"command line", {{"env_framestack", "1"}, {"lr", "1e-3"}}}),
              IsEmpty());
  // vdn has a recurrent core here, so sequences are drawn.
  EXPECT_THAT(flags_without_effect(
                  config, {"command line", {{"qmix_batch_sequences", "9"}, {"dqn_batch_decisions", "5"}}}),
              ElementsAre(AllOf(HasSubstr("--dqn_batch_decisions 5 does nothing"),
                                HasSubstr("applies with idqn without a recurrent core"))));
}

TEST(FlagsWithoutEffect, AMapThatWasMadeForTheRunHidesNoSeed) {
  RunConfig config;
  config.run.scenario = "lava_pit";
  config.environment.layout_seed = 7;
  config.environment.wad = "/train_dir/run/layouts/lava_pit_7.wad";
  const SettingsLayer typed{"command line", {{"layout_seed", "7"}}};
  EXPECT_THAT(flags_without_effect(config, typed), IsEmpty());
  config.environment.wad = "/home/me/mine.wad";
  EXPECT_THAT(flags_without_effect(config, typed), ElementsAre(HasSubstr("--layout_seed 7 does nothing")));
}

TEST(FlagsUnusedByEval, AreThoseOfTraining) {
  EXPECT_THAT(
      flags_unused_by_eval({"command line", {{"seed", "3"}, {"learning_rate", "1e-3"}, {"wad", "a"}}}),
      ElementsAre(HasSubstr("--learning_rate 1e-3 does nothing in an evaluation")));
}

TEST(Changes, NameBothValuesAndLeaveOutWhereTheRunLies) {
  RunConfig before, now;
  EXPECT_EQ(changes_text(before, now), "");
  before.optimisation.gamma = 0.995;
  now.optimisation.gamma = 0.9;
  before.environment.layout_pool = "";
  now.environment.layout_pool = "train:5";
  now.run.train_dir = "/elsewhere";
  now.run.restart_behavior = RestartBehavior::kOverwrite;
  EXPECT_EQ(changes_text(before, now),
            "changed since the last start: layout_pool empty -> train:5, gamma 0.995 -> 0.9");
}

TEST(Changes, AMapThatWasRedrawnIsNamedByItsSeed) {
  RunConfig before;
  before.run.scenario = "lava_pit";
  before.environment.layout_seed = 1;
  before.environment.wad = "/old/run/layouts/lava_pit_1.wad";
  RunConfig now = before;
  now.environment.layout_seed = 2;
  now.environment.wad = "/new/run/layouts/lava_pit_2.wad";
  EXPECT_EQ(changes_text(before, now), "changed since the last start: layout_seed 1 -> 2");
  now.environment.wad = "/home/me/mine.wad";
  EXPECT_THAT(changes_text(before, now),
              HasSubstr("wad /old/run/layouts/lava_pit_1.wad -> /home/me/mine.wad"));
}

TEST(LeftOut, IsNamedForARunsConfigAlone) {
  EXPECT_EQ(left_out_text({"mine.toml", {{"gamma", "0.9"}}}), "");
  SettingsLayer of_a_run{"old/config.toml", {{"num_workers", "2"}, {"wad", "a.wad"}}};
  of_a_run.explicit_values = {{"num_workers", "0"}, {"wad", ""}};
  EXPECT_THAT(left_out_text(of_a_run), AllOf(HasSubstr("old/config.toml"), HasSubstr("(num_workers, wad)")));
}

TEST(LeftOut, ARunsConfigOfAnOlderVersionIsTakenWhole) {
  SettingsLayer of_a_run{"old/config.toml", {}, {}};
  for (const SettingRow& row : setting_rows())
    of_a_run.values.emplace_back(std::string(row.name), row.text(RunConfig()));
  EXPECT_THAT(left_out_text(of_a_run),
              AllOf(HasSubstr("old/config.toml has no table [explicit]"), HasSubstr("older version wrote"),
                    HasSubstr("all its settings apply")));
  of_a_run.explicit_values = {{"num_workers", "0"}};
  EXPECT_THAT(left_out_text(of_a_run), ::testing::Not(HasSubstr("older version")));
}

}  // namespace start_notes_test
}  // namespace comrad::deploy
