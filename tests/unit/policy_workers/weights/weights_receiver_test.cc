#include "policy_workers/weights/weights_receiver.h"

#include <gtest/gtest.h>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::policy {
namespace weights_receiver_test {

TEST(WeightsReceiver, TakesEveryNewerVersionOnce) {
  const NetworkOptions options = small_network();
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const ActorCritic policy = ActorCritic::create(options, 2, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, learner.weights_bytes());
  WeightsReceiver receiver(arena);
  auto refreshed = receiver.refresh(policy);
  ASSERT_TRUE(refreshed);
  EXPECT_FALSE(*refreshed) << "nothing is published";
  EXPECT_FALSE(receiver.version());
  for (const PolicyVersion version :
       {0u, 1u, 2u}) {  // version 0: a network that no optimizer step has touched
    learner.update_input_statistics(torch::randint(0, 256, {3, 3, 40, 44}, torch::kUInt8), {});
    arena.weights().publish(learner.weights(), version);
    refreshed = receiver.refresh(policy);
    ASSERT_TRUE(refreshed) << refreshed.error().message;
    EXPECT_TRUE(*refreshed);
    EXPECT_EQ(receiver.version(), version);
    EXPECT_EQ(policy.weights(), learner.weights());
    refreshed = receiver.refresh(policy);
    ASSERT_TRUE(refreshed);
    EXPECT_FALSE(*refreshed);
  }
}

TEST(WeightsReceiver, RefusesWeightsOfAnotherNetworkAndKeepsItsOwn) {
  const NetworkOptions options = small_network();
  const ActorCritic policy = ActorCritic::create(options, 2, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, policy.weights_bytes());
  WeightsReceiver receiver(arena);
  const std::vector<std::byte> own = policy.weights();
  arena.weights().publish(std::vector<std::byte>(own.size() - 4), 1);
  const auto refreshed = receiver.refresh(policy);
  ASSERT_FALSE(refreshed);
  EXPECT_EQ(refreshed.error().code, ErrorCode::kBadFormat);
  EXPECT_EQ(policy.weights(), own);
  EXPECT_FALSE(receiver.version());
}

}  // namespace weights_receiver_test
}  // namespace comrad::policy
