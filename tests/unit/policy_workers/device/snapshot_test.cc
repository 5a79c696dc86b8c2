// The host gets tensors as they were when they were requested; on a GPU too (COMRAD_TEST_DEVICE).
#include "policy_workers/device/snapshot.h"

#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "policy_workers/device/readback.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/test_device.h"

namespace comrad::device {
namespace snapshot_test {

TEST(Snapshot, HoldsWhatTensorsWereWhenItWasTaken) {
  const torch::Device device = test::test_device();
  const auto on_device = torch::TensorOptions().device(device);
  Tensor matrix = torch::arange(6, on_device.dtype(torch::kFloat32)).view({2, 3});
  const Tensor transposed = matrix.t(), one = torch::full({}, 7.5, on_device.dtype(torch::kFloat64));
  Snapshot snapshot;
  EXPECT_TRUE(snapshot.is_ready());
  EXPECT_TRUE(snapshot.bytes().empty());
  for (int round = 0; round < 3; ++round) {  // its memory is used again
    snapshot.take({transposed, one});
    matrix.add_(1);
    snapshot.wait();
    ASSERT_TRUE(snapshot.is_ready());
    ASSERT_EQ(snapshot.bytes().size(), 6 * sizeof(float) + sizeof(double));
    std::vector<float> numbers(6);
    double last = 0;
    std::memcpy(numbers.data(), snapshot.bytes().data(), 6 * sizeof(float));
    std::memcpy(&last, snapshot.bytes().data() + 6 * sizeof(float), sizeof last);
    const auto first = static_cast<float>(round);
    EXPECT_EQ(numbers, (std::vector<float>{first, first + 3, first + 1, first + 4, first + 2, first + 5}));
    EXPECT_EQ(last, 7.5);
  }
  snapshot.take({one});
  snapshot.wait();
  EXPECT_EQ(snapshot.bytes().size(), sizeof(double));
}

TEST(Snapshot, IsThereOnceItWasWaitedForWhereTheDeviceIsSlow) {
  const SlowReadbacks slow;
  Snapshot snapshot;
  snapshot.take({torch::zeros({2})});
  EXPECT_FALSE(snapshot.is_ready());
  snapshot.wait();
  EXPECT_TRUE(snapshot.is_ready());
}

}  // namespace snapshot_test
}  // namespace comrad::device
