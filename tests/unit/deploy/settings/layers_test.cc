#include "deploy/settings/layers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace layers_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

TEST(Merge, TheLastLayerThatNamesASettingWinsAndIsRemembered) {
  const NamedLayer layers[] = {{"low", {"low.toml", {{"gamma", "0.9"}, {"lr", "1e-3"}}}},
                               {"high", {"high.toml", {{"gamma", "0.5"}, {"seed", "42"}}}}};
  const Expected<LayeredConfig> merged = merge(RunConfig(), "built-in", layers);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.optimisation.gamma, 0.5);
  EXPECT_EQ(merged->from.at("gamma"), "high");
  EXPECT_EQ(merged->from.at("learning_rate"), "low") << "under its old name";
  EXPECT_EQ(merged->from.at("seed"), "high") << "named, though it is the built-in value";
  EXPECT_EQ(merged->from.at("rollout"), "built-in");
  EXPECT_EQ(merged->from.size(), setting_rows().size());
}

// A name that means a part of a setting changes what the layers below left of it.
TEST(Merge, EachLayerIsAppliedOnTopOfTheOnesBefore) {
  const NamedLayer layers[] = {{"preset", {"preset", {{"epsilon", "1@0..0.05@3e5"}}}},
                               {"command line", {"command line", {{"epsilon_end", "0.2"}}}}};
  const Expected<LayeredConfig> merged = merge(RunConfig(), "built-in", layers);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->config.q_learning.epsilon.text(), Schedule::line(1, 0.2, 3e5).text());
  EXPECT_EQ(merged->from.at("epsilon"), "command line");
  EXPECT_EQ(merged->from.size(), setting_rows().size());
}

TEST(Merge, NamesTheLayerThatItCannotApply) {
  const NamedLayer layers[] = {{"file", {"my.toml", {{"gama", "1"}}}}};
  const Expected<LayeredConfig> merged = merge(RunConfig(), "built-in", layers);
  ASSERT_FALSE(merged);
  EXPECT_THAT(merged.error().message, HasSubstr("my.toml: unknown setting 'gama'"));
}

TEST(Only, PicksSettingsByAnyOfTheirNames) {
  const std::string_view names[] = {"learning_rate", "seed"};
  const SettingsLayer some = only({"x", {{"lr", "1"}, {"gamma", "2"}, {"seed", "3"}}}, names);
  EXPECT_EQ(some.origin, "x");
  EXPECT_THAT(some.values, ElementsAre(Pair("lr", "1"), Pair("seed", "3")));
}

}  // namespace layers_test
}  // namespace comrad::deploy
