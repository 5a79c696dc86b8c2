#include "deploy/bench/tune_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "rollout_buffer/settings/layers.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace tune_search_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::IsEmpty;
using ::testing::Pair;

const std::vector<TuneAxis> kAxes = {{{{"precision", "bf16"}}},
                                     {{{"num_workers", "1"}}, {{"num_workers", "3"}}}};

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

TEST(Tune, ValuesThatBelongTogetherWinTogether) {
  const std::map<std::string, double> worth = {
      {"num_workers=3", 1.1}, {"worker_num_splits=1", 0.9}, {"min_batch=8", 1.02}, {"min_batch=16", 1.2}};
  const auto result = tune(
      {{{{"num_workers", "3"}}, {{"min_batch", "8"}}},
       {{{"worker_num_splits", "1"}}, {{"worker_num_splits", "1"}, {"min_batch", "16"}}}},
      [&](const TunedSettings& one) { return rate_of(one, worth); }, always);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_THAT(result->best,
              ElementsAre(Pair("num_workers", "3"), Pair("worker_num_splits", "1"), Pair("min_batch", "16")));
  EXPECT_NEAR(result->ratio, 1.1 * 0.9 * 1.2, 1e-9);
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
      {{{{"precision", "bf16"}}}}, [&](const TunedSettings&) { return ++calls == 2 ? 2000.0 : 1000.0; },
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
  config.collection.policy_workers = 1;
  config.collection.learner_threads = 2;
  config.collection.policy_threads = 1;
  config.collection.worker_num_splits = 2;
  config.collection.min_batch = 4;
  const auto one = [](const std::string& setting, const std::string& value) {
    return TunedSettings{{setting, value}};
  };
  EXPECT_THAT(tune_axes(config, 2),
              ElementsAre(ElementsAre(one("precision", "bf16")),
                          ElementsAre(one("num_workers", "1"), one("num_workers", "3")),
                          ElementsAre(one("num_envs_per_worker", "4"), one("num_envs_per_worker", "16")),
                          ElementsAre(one("learner_threads", "1")), ElementsAre(one("policy_threads", "2")),
                          ElementsAre(one("min_batch", "2"), one("min_batch", "8")),
                          ElementsAre(one("worker_num_splits", "1"),
                                      TunedSettings{{"worker_num_splits", "1"}, {"min_batch", "16"}})))
      << "two cores have one batch at a time: nothing is tried of policy_workers";
  config.collection.worker_num_splits = 1;
  config.collection.min_batch = 16;
  EXPECT_THAT(tune_axes(config, 2).back(), ElementsAre(one("worker_num_splits", "2")))
      << "one split and whole batches are there already";
}

}  // namespace tune_search_test
}  // namespace comrad::deploy
