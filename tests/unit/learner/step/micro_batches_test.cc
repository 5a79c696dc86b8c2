#include "learner/step/micro_batches.h"

#include <gtest/gtest.h>

#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace micro_batches_test {

TEST(Parts, AreOfTheSizeThatSuitsTheDeviceUnlessOneIsSet) {
  RunConfig config;
  config.collection.learner_threads = 16;
  EXPECT_EQ(samples_of_part(config, torch::kCPU), 512);
  EXPECT_EQ(samples_of_part(config, torch::kCUDA), 4096);
  EXPECT_EQ(threads_for_parts(config, torch::kCPU), 16);
  EXPECT_EQ(threads_for_parts(config, torch::kCUDA), 1);
  config.optimisation.micro_batch_size = 4096;
  EXPECT_EQ(samples_of_part(config, torch::kCPU), 4096);
  EXPECT_EQ(threads_for_parts(config, torch::kCPU), 2) << "activations of more would take too much memory";
}

}  // namespace micro_batches_test
}  // namespace comrad::learn
