#include "sim_workers/worker/bench.h"

#include <gtest/gtest.h>

#include "tests/support/small_arena.h"
#include "tests/support/toy_environment.h"

namespace comrad::sim {
namespace {

TEST(Bench, CountsAgentDecisionsInTheTimeItMeasured) {
  testing::ToyEnvironmentSet environments(
      {.shape = testing::small_arena_shape().trajectory.env, .min_length = 3, .max_length = 9}, 5);
  uint64_t observed = 0;
  environments.on_observe = [&observed] { ++observed; };
  const BenchResult result = run_bench(environments, {.seconds = 0.2, .warmup_seconds = 0.01});
  EXPECT_GE(result.seconds, 0.2);
  EXPECT_LT(result.seconds, 5.0);
  EXPECT_GT(result.decisions, 0u);
  EXPECT_EQ(result.decisions % (5 * 2), 0u) << "whole rounds of five environments with two agents";
  EXPECT_GT(result.episodes, 0u);
  EXPECT_GE(observed, 2 * result.decisions / 10 + result.episodes)
      << "both halves and every final were rendered";
}

}  // namespace
}  // namespace comrad::sim
