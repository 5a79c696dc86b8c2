#include "policy_workers/worker/policy_threads.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/patience.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::policy {
namespace policy_threads_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(PolicyThreads, EachAnswersItsSplitsUntilTheyAreStopped) {
  const NetworkOptions options = small_network();
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const shm::Arena arena = make_arena(options, {.policy_workers = 2}, learner.weights_bytes());
  RunConfig config = small_config();
  config.collection.max_wait_us = 10'000'000;  // a split is one batch, however slowly it is committed
  FakeSplit first(arena, 0, 0), second(arena, 0, 1);
  {
    LocalWeights weights;
    const PolicyThreads threads(config, arena, weights);
    weights.publish(learner.weight_tensors(), 3);
    for (FakeSplit* split : {&first, &second}) {
      split->commit_act(true);
      ASSERT_TRUE(split->await());
      for (FakeEnv& env : split->envs) EXPECT_EQ(env.slab().policy_version(env.step(), 0), 3u);
      split->take_act();
    }
    EXPECT_TRUE(threads.check());
    EXPECT_FALSE(arena.weights().has_any());
    EXPECT_NE(arena.control().run_state.load(), shm::RunState::kStopping);
  }
  for (int worker = 0; worker < 2; ++worker) {
    EXPECT_EQ(arena.policy_counters(worker).batches.load(), 1u);
    EXPECT_EQ(arena.policy_counters(worker).state.load(), shm::WorkerState::kStopped);
  }
}

TEST(PolicyThreads, TheFirstErrorIsKept) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.policy_workers = 2}, /*weights_bytes=*/64);
  const RunConfig config = small_config();
  const LocalWeights weights;
  const PolicyThreads threads(config, arena, weights);
  ASSERT_TRUE(test::wait_until([&] { return !threads.check(); }));
  EXPECT_EQ(threads.check().error().code, ErrorCode::kBadInput);
  EXPECT_THAT(threads.check().error().message, AllOf(StartsWith("policy-"), HasSubstr("the arena holds 64")));
}

}  // namespace policy_threads_test
}  // namespace comrad::policy
