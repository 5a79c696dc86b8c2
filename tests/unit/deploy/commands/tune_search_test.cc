#include "deploy/commands/tune_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "rollout_buffer/settings/layers.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::IsEmpty;
using ::testing::Pair;

const std::vector<TuneAxis> kAxes = {{"precision", {"bf16"}}, {"num_workers", {"1", "3"}}};

bool always() { return true; }

/// A machine whose rate is the product of what each value is worth.
Expected<double> rate_of(const TunedSettings& settings, const std::map<std::string, double>& worth) {
  double rate = 1000;
  for (const auto& [setting, value] : settings) rate *= worth.at(setting + "=" + value);
  return rate;
}

TEST(Tune, FindsWhatIsFasterTogether) {
  const std::map<std::string, double> worth = {
      {"precision=bf16", 1.4}, {"num_workers=1", 0.8}, {"num_workers=3", 1.1}};
  const auto result = tune(
      kAxes, [&](const TunedSettings& one) { return rate_of(one, worth); }, always);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_THAT(result->best, ElementsAre(Pair("precision", "bf16"), Pair("num_workers", "3")));
  EXPECT_NEAR(result->ratio, 1.4 * 1.1, 1e-9);
  EXPECT_TRUE(result->is_whole);
}

TEST(Tune, KeepsWhatIsThereWhereNothingIsFasterByEnough) {
  const std::map<std::string, double> worth = {
      {"precision=bf16", 1.02}, {"num_workers=1", 0.5}, {"num_workers=3", 1.0}};
  const auto result = tune(
      kAxes, [&](const TunedSettings& one) { return rate_of(one, worth); }, always);
  ASSERT_TRUE(result);
  EXPECT_THAT(result->best, IsEmpty());
  EXPECT_EQ(result->ratio, 1);
}

TEST(Tune, OneLuckyMomentDecidesNothing) {
  int calls = 0;
  const auto result = tune(
      {{"precision", {"bf16"}}}, [&](const TunedSettings&) { return ++calls == 2 ? 2000.0 : 1000.0; },
      always);
  ASSERT_TRUE(result);
  EXPECT_THAT(result->best, IsEmpty());
  EXPECT_EQ(calls, 4) << "the best so far and the value, twice each";
}

TEST(Tune, ValuesThatCannotBeRunArePassedOver) {
  const auto result = tune(
      kAxes,
      [](const TunedSettings& one) -> Expected<double> {
        if (!one.empty() && one.back().second == "3") return Error{ErrorCode::kNoSpace, "no memory for 3"};
        return one.empty() ? 1000.0 : 900.0;
      },
      always);
  ASSERT_TRUE(result);
  EXPECT_THAT(result->best, IsEmpty());
  EXPECT_THAT(result->tries, Contains(Field(&TuneTry::failure, "no memory for 3")));
}

TEST(Tune, SettingsThatCannotBeginAreAnError) {
  const auto result = tune(
      kAxes,
      [](const TunedSettings&) -> Expected<double> {
        return Error{ErrorCode::kNotFound, "no IWAD"};
      },
      always);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().message, "no IWAD");
}

TEST(Tune, StopsWhenTimeIsUp) {
  int asked = 0;
  const auto result = tune(
      kAxes, [](const TunedSettings&) { return 1000.0; }, [&] { return ++asked == 1; });
  ASSERT_TRUE(result);
  EXPECT_FALSE(result->is_whole);
  EXPECT_EQ(result->tries.size(), 2u);
}

TEST(Tune, WhatItFindsIsAFileThatTrainTakes) {
  const test::ScratchFolder folder;
  const auto layer = read_settings_toml(
      folder.write("tuned.toml", "# found\n" + toml_of({{"precision", "bf16"}, {"num_workers", "3"}})));
  ASSERT_TRUE(layer) << layer.error().message;
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, *layer));
  EXPECT_EQ(config.collection.precision, Precision::kBf16);
  EXPECT_EQ(config.collection.num_workers, 3);
  EXPECT_EQ(toml_of({}), "");
}

TEST(TuneAxes, HoldOtherValuesThanThoseInForce) {
  RunConfig config;
  config.collection.num_workers = 2;
  config.collection.num_envs_per_worker = 8;
  config.collection.learner_threads = 2;
  config.collection.policy_threads = 1;
  std::map<std::string, std::vector<std::string>> axes;
  for (const TuneAxis& axis : tune_axes(config, 2)) axes[axis.setting] = axis.values;
  EXPECT_THAT(axes["precision"], ElementsAre("bf16"));
  EXPECT_THAT(axes["num_workers"], ElementsAre("1", "3"));
  EXPECT_THAT(axes["num_envs_per_worker"], ElementsAre("4", "16"));
  EXPECT_THAT(axes["learner_threads"], ElementsAre("1"));
  EXPECT_THAT(axes["policy_threads"], ElementsAre("2"));
  EXPECT_FALSE(axes.contains("policy_workers")) << "two cores have one batch at a time";
}

}  // namespace
}  // namespace comrad::deploy
