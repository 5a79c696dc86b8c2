// What a plan requires of shared memory.
#include "deploy/launch/launch_plan.h"

#include <gtest/gtest.h>

namespace comrad::deploy {
namespace launch_plan_test {

TEST(LaunchPlan, JournalsHoldTheLongestEpisodeWhateverTheFrameSkip) {
  LaunchPlan plan;
  plan.env.num_agents = 2;
  plan.env.head_count = 1;
  plan.env.head_sizes[0] = 3;
  plan.config.collection.deterministic = true;
  plan.decision_limit = 100;  // 400 tics
  const auto steps = [&](int64_t frame_skip) {
    plan.config.environment.env_frameskip = frame_skip;
    const auto shape = arena_shape(plan);
    EXPECT_TRUE(shape) << shape.error().message;
    return shape ? shape->journal_steps : -1;
  };
  EXPECT_EQ(steps(4), 101);
  EXPECT_EQ(steps(1), 401);
  EXPECT_EQ(steps(3), 135);
  plan.decision_limit = 0;
  EXPECT_FALSE(arena_shape(plan));
}

}  // namespace launch_plan_test
}  // namespace comrad::deploy
