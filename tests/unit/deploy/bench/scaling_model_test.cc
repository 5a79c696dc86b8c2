#include "deploy/bench/scaling_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace scaling_model_test {

using nlohmann::ordered_json;
using ::testing::HasSubstr;

/// Milliseconds of a decision: simulators 0.1, policy workers 0.1 (forward 0.08), learner 0.3 (both passes 0.25).
ordered_json bench_train() {
  return {{"cpu_seconds_per_1000_decisions",
           {{"tic", 0.03},
            {"render", 0.06},
            {"hand_over", 0.01},
            {"gather", 0.004},
            {"weights", 0.004},
            {"pack", 0.002},
            {"forward", 0.08},
            {"scatter", 0.01},
            {"collate", 0.02},
            {"forward_backward", 0.25},
            {"optimizer", 0.02},
            {"publish", 0.01},
            {"other", 0.0}}}};
}

RunConfig settings(int64_t workers, int64_t policy_workers, int64_t learner_threads) {
  RunConfig config;
  config.collection.num_workers = workers;
  config.collection.policy_workers = policy_workers;
  config.collection.policy_threads = 1;
  config.collection.learner_threads = learner_threads;
  return config;
}

TEST(DecisionCosts, AreReadFromABenchOrRefused) {
  const auto costs = DecisionCosts::from(bench_train());
  ASSERT_TRUE(costs);
  EXPECT_DOUBLE_EQ(costs->all_s(), 0.5e-3);
  EXPECT_DOUBLE_EQ(costs->simulators_s(), 0.1e-3);
  EXPECT_DOUBLE_EQ(costs->policy_workers_s(), 0.1e-3);
  ordered_json broken = bench_train();
  broken["cpu_seconds_per_1000_decisions"].erase("publish");
  EXPECT_THAT(DecisionCosts::from(broken).error().message, HasSubstr("has no publish"));
  broken = bench_train();
  broken["cpu_seconds_per_1000_decisions"]["tic"] = -1;
  EXPECT_FALSE(DecisionCosts::from(broken));
  for (auto& [name, value] : broken["cpu_seconds_per_1000_decisions"].items()) value = 0;
  EXPECT_FALSE(DecisionCosts::from(broken));
  EXPECT_FALSE(DecisionCosts::from(ordered_json("text")));
  EXPECT_FALSE(DecisionCosts::from(ordered_json::object()));
}

TEST(ModelRow, FewCoresAreAllBusy) {
  const ModelRow row = model_row(*DecisionCosts::from(bench_train()), settings(1, 1, 2), 1);
  EXPECT_DOUBLE_EQ(row.rate, 2000);
  EXPECT_EQ(row.saturates, "all cores");
  EXPECT_DOUBLE_EQ(model_row(*DecisionCosts::from(bench_train()), settings(2, 1, 2), 2).rate, 4000);
}

TEST(ModelRow, ManyCoresWaitForTheLeastOfTheParts) {
  const DecisionCosts costs = *DecisionCosts::from(bench_train());
  const ModelRow learner = model_row(costs, settings(16, 2, 8), 16);
  EXPECT_EQ(learner.saturates, "learner");
  EXPECT_DOUBLE_EQ(learner.rate, 1 / (0.25e-3 / 8 + 0.03e-3)) << "the step and publishing are not shared out";
  const ModelRow policy = model_row(costs, settings(16, 1, 16), 16);
  EXPECT_EQ(policy.saturates, "policy workers");
  EXPECT_DOUBLE_EQ(policy.rate, 1 / 0.1e-3);
  const ModelRow simulators = model_row(costs, settings(1, 16, 16), 32);
  EXPECT_EQ(simulators.saturates, "simulators");
  EXPECT_DOUBLE_EQ(simulators.rate, 1 / 0.1e-3);
}

TEST(ModelRow, ProcessesBeyondTheCoresAddNothing) {
  const DecisionCosts costs = *DecisionCosts::from(bench_train());
  EXPECT_DOUBLE_EQ(model_row(costs, settings(64, 1, 1), 4).simulators, 4 / 0.1e-3);
}

TEST(ModelTable, HasARowForEveryNumberOfCoresWithItsOwnSettings) {
  const auto settings_on = [](int cores) -> Expected<RunConfig> {
    if (cores > 100) return Error{ErrorCode::kBadInput, "too many"};
    return settings(cores, 1, cores);
  };
  const auto rows = model_table(*DecisionCosts::from(bench_train()), {1, 8}, settings_on);
  ASSERT_TRUE(rows);
  ASSERT_EQ(rows->size(), 2u);
  EXPECT_EQ((*rows)[1]["cores"], 8);
  EXPECT_EQ((*rows)[1]["num_workers"], 8);
  EXPECT_DOUBLE_EQ((*rows)[0]["decisions_per_s"].get<double>(), 2000);
  EXPECT_DOUBLE_EQ((*rows)[0]["env_frames_per_s"].get<double>(), 8000);
  EXPECT_FALSE(model_table(*DecisionCosts::from(bench_train()), {1, 200}, settings_on));
}

}  // namespace scaling_model_test
}  // namespace comrad::deploy
