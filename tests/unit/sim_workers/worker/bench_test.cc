#include "sim_workers/worker/bench.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include "rollout_buffer/core/clock.h"
#include "tests/support/small_arena.h"
#include "tests/support/toy_environment.h"

namespace comrad::sim {
namespace bench_test {

TEST(Bench, CountsAgentDecisionsInTheTimeItMeasured) {
  test::ToyEnvironmentSet environments(
      {.shape = test::small_arena_shape().trajectory.env, .min_length = 3, .max_length = 9}, 5);
  uint64_t observed = 0;
  environments.on_observe = [&observed] { ++observed; };
  const BenchResult result = run_bench(environments, {.seconds = 1, .warmup_seconds = 0.01});
  EXPECT_GE(result.seconds, 1);
  EXPECT_GT(result.decisions, 0u);
  EXPECT_EQ(result.decisions % (5 * 2), 0u) << "whole rounds of five environments with two agents";
  EXPECT_GT(result.episodes, 0u);
  EXPECT_GE(observed, 2 * result.decisions / 10 + result.episodes)
      << "both halves and every final were rendered";
  EXPECT_GE(result.windows.size(), 1u);
  for (const double rate : result.windows) EXPECT_GT(rate, 0);
  EXPECT_GT(result.tic_cpu_seconds, 0);
  EXPECT_GT(result.render_cpu_seconds, 0);
  EXPECT_LE(result.tic_cpu_seconds + result.render_cpu_seconds, result.cpu_seconds * 1.05);
}

TEST(Bench, TheEngineAlonePlaysEpisodesAndDrawsNothing) {
  test::ToyEnvironmentSet environments(
      {.shape = test::small_arena_shape().trajectory.env, .min_length = 3, .max_length = 9}, 5);
  uint64_t observed = 0;
  environments.on_observe = [&observed] { ++observed; };
  const BenchResult result =
      run_bench(environments, {.part = BenchPart::kEngine, .seconds = 0.1, .warmup_seconds = 0.01});
  EXPECT_GT(result.decisions, 0u);
  EXPECT_GT(result.episodes, 0u);
  EXPECT_EQ(observed, 0u);
  EXPECT_EQ(result.render_cpu_seconds, 0);
}

TEST(Bench, DrawingAloneCountsTheTimeOfTheViewsAndNothingElse) {
  test::ToyEnvironmentSet environments(
      {.shape = test::small_arena_shape().trajectory.env, .min_length = 3, .max_length = 9}, 5);
  environments.on_observe = [] { usleep(1000); };
  const Stopwatch clock;
  const BenchResult result = run_bench(
      environments, {.part = BenchPart::kRender, .seconds = 0.1, .warmup_seconds = 0.01, .splits = 1});
  EXPECT_GE(result.seconds, 0.1);
  EXPECT_LT(result.seconds, clock.elapsed() - 0.01) << "tics, finals and the warm-up do not count";
  EXPECT_LE(static_cast<double>(result.decisions) / 10, result.seconds / 0.001 + 1) << "a round takes 1 ms";
}

}  // namespace bench_test
}  // namespace comrad::sim
