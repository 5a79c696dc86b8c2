#include "rollout_buffer/settings/other_names.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {
namespace other_names_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// The message of what a flag of Sample Factory is answered with; empty where it is taken.
std::string answer(const char* name, const char* value, RunConfig& config) {
  const Status set = apply_layer(config, {"command line", {{name, value}}});
  return set ? "" : set.error().message;
}
std::string answer(const char* name, const char* value) {
  RunConfig config;
  return answer(name, value, config);
}

TEST(OtherNames, WhatIsDoneInAnyCaseIsTaken) {
  EXPECT_EQ(answer("env_framestack", "1"), "");
  EXPECT_EQ(answer("recurrence", "-1"), "");
  EXPECT_EQ(answer("nonlinearity", "elu"), "");
  EXPECT_EQ(answer("optimizer", "Adam"), "");
  EXPECT_EQ(answer("with_wandb", "False"), "");
  EXPECT_EQ(answer("with_wandb", "0"), "");
  EXPECT_EQ(answer("num_policies", "1"), "");
}

TEST(OtherNames, ACoreSetsWhatItStandsFor) {
  RunConfig config;
  EXPECT_EQ(answer("core", "lstm 64 x2", config), "");
  EXPECT_EQ(config.network.rnn_type, RnnType::kLstm);
  EXPECT_EQ(config.network.rnn_size, 64);
  EXPECT_EQ(config.network.rnn_num_layers, 2);
  for (const std::string_view name : find_other_name("core")->sets)
    EXPECT_NE(find_setting(name), nullptr) << name;
  EXPECT_EQ(answer("core", "none", config), "");
  EXPECT_FALSE(config.network.use_rnn);
  EXPECT_THAT(answer("core", "gru"), AllOf(HasSubstr("core is 'gru'"), HasSubstr("gru 256, lstm 512 x2")));
}

TEST(OtherNames, WhatIsNotThereIsAnsweredWithWhatToUse) {
  EXPECT_THAT(answer("env_framestack", "4"),
              AllOf(HasSubstr("env_framestack 4"), HasSubstr("--use_rnn"), Not(HasSubstr("frameskip"))));
  EXPECT_THAT(answer("recurrence", "8"), HasSubstr("--rollout"));
  EXPECT_THAT(answer("nonlinearity", "relu"), HasSubstr("ELU"));
  EXPECT_THAT(answer("optimizer", "lamb"), HasSubstr("Adam"));
  EXPECT_THAT(answer("with_wandb", "True"), AllOf(HasSubstr("comrad export RUN"), HasSubstr("wandb sync")));
  EXPECT_THAT(answer("num_policies", "2"), AllOf(HasSubstr("--seed"), HasSubstr("--share_parameters=False")));
}

TEST(OtherNames, ValueBootstrapIsTheOppositeOfLegacyTimeouts) {
  RunConfig config;
  EXPECT_EQ(answer("value_bootstrap", "False", config), "");
  EXPECT_TRUE(config.optimisation.legacy_timeouts);
  EXPECT_EQ(answer("value_bootstrap", "True", config), "");
  EXPECT_FALSE(config.optimisation.legacy_timeouts);
  EXPECT_THAT(answer("value_bootstrap", "perhaps"), HasSubstr("true or false"));
  EXPECT_EQ(find_setting("value_bootstrap"), find_setting("legacy_timeouts"));
}

TEST(OtherNames, DeviceGpuIsCuda) {
  RunConfig config;
  config.environment.num_agents = 2;
  ASSERT_EQ(answer("device", "gpu", config), "");
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_EQ(config.collection.device, "cuda");
}

TEST(OtherNames, NoneIsASettingAndTheFlagsTheyNameExist) {
  for (const OtherName& other : other_names()) {
    for (const SettingRow& row : setting_rows()) EXPECT_FALSE(row.has_name(other.name)) << other.name;
    EXPECT_EQ(!other.setting.empty() + !other.instead.empty() + (other.assign != nullptr), 1) << other.name;
    for (std::size_t at = 0; (at = other.instead.find("--", at)) != std::string_view::npos;) {
      at += 2;
      const std::size_t end = std::min(
          other.instead.find_first_not_of("abcdefghijklmnopqrstuvwxyz_0123456789", at), other.instead.size());
      EXPECT_NE(find_setting(other.instead.substr(at, end - at)), nullptr) << other.name;
    }
  }
}

}  // namespace other_names_test
}  // namespace comrad
