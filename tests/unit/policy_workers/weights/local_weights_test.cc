#include "policy_workers/weights/local_weights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/weights/weights_receiver.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::policy {
namespace local_weights_test {

/// Numbers of several types, none of which fills an aligned place, all equal to `number`.
std::vector<torch::Tensor> tensors_of(double number) {
  return {torch::full({3, 7}, number, torch::kFloat32), torch::full({}, number, torch::kFloat64),
          torch::full({5001}, number, torch::kFloat32), torch::full({2}, number, torch::kInt64)};
}

TEST(LocalWeights, EveryReaderGetsWholeVersionsInTheirOrder) {
  constexpr PolicyVersion kLast = 400;
  LocalWeights weights;
  EXPECT_FALSE(weights.version());
  weights.publish(tensors_of(0), 0);
  EXPECT_EQ(weights.version(), 0u);
  std::vector<std::thread> readers;
  for (int reader = 0; reader < 3; ++reader)
    readers.emplace_back([&weights] {
      const std::vector<torch::Tensor> mine = tensors_of(-1);
      for (PolicyVersion version = 0; version < kLast;) {
        const PolicyVersion least = *weights.version(), read = weights.read(mine);
        ASSERT_GE(least, version);
        ASSERT_GE(read, least);
        version = read;
        for (const torch::Tensor& tensor : mine)
          ASSERT_TRUE((tensor == static_cast<double>(version)).all().item<bool>()) << "version " << version;
      }
    });
  for (PolicyVersion version = 1; version <= kLast; ++version) weights.publish(tensors_of(version), version);
  for (std::thread& reader : readers) reader.join();
}

TEST(LocalWeights, AVersionIsCopiedOnceByTheLearnerAndOnceByEachWorker) {
  const test::ScratchFolder folder;
  ASSERT_TRUE(share_stages(folder.string(), "learner"));
  const auto copied = [] { return stage_counters()->copied_bytes.load(); };
  const NetworkOptions options = small_network();
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const ActorCritic policy = ActorCritic::create(options, 2, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, learner.weights_bytes());
  const auto bytes = static_cast<uint64_t>(learner.weights_bytes());
  LocalWeights weights;
  WeightsReceiver receiver(arena, &weights);
  EXPECT_FALSE(*receiver.refresh(policy)) << "nothing is published";
  for (const PolicyVersion version : {0u, 1u, 2u}) {
    learner.update_input_statistics(torch::randint(0, 256, {3, 3, 40, 44}, torch::kUInt8), {});
    const uint64_t before = copied();
    weights.publish(learner.weight_tensors(), version);
    EXPECT_EQ(copied() - before, bytes);
    EXPECT_TRUE(*receiver.refresh(policy));
    EXPECT_EQ(copied() - before, 2 * bytes);
    EXPECT_EQ(receiver.version(), version);
    EXPECT_EQ(policy.weights(), learner.weights());
    EXPECT_FALSE(*receiver.refresh(policy));
    EXPECT_EQ(copied() - before, 2 * bytes);
  }
  EXPECT_FALSE(arena.weights().has_any()) << "whose bytes have a checksum";
}

}  // namespace local_weights_test
}  // namespace comrad::policy
