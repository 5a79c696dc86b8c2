// Tensors of a device get a host's bytes; on a GPU too (COMRAD_TEST_DEVICE).
#include "policy_workers/device/upload.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <vector>

#include "policy_workers/device/snapshot.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/test_device.h"

namespace comrad::device {
namespace upload_test {

TEST(Upload, WritesTensorsOfAnyShapeAndTypeOneAfterAnother) {
  const auto on_device = torch::TensorOptions().device(test::test_device());
  const Tensor matrix = torch::zeros({3, 2}, on_device),
               one = torch::zeros({}, on_device.dtype(torch::kFloat64));
  const Tensor byte = torch::zeros({1}, on_device.dtype(torch::kUInt8)), none = torch::zeros({0}, on_device);
  const std::vector<Tensor> tensors = {byte, matrix.t(), none, one};
  std::vector<std::byte> bytes(1 + 6 * sizeof(float) + sizeof(double));
  Upload upload;
  for (int round = 0; round < 3; ++round) {  // its memory is used again
    const auto first = static_cast<float>(round);
    const std::vector<float> numbers = {first, first + 1, first + 2, first + 3, first + 4, first + 5};
    const double last = 7.5 + round;
    bytes[0] = std::byte{200};
    std::memcpy(bytes.data() + 1, numbers.data(), 6 * sizeof(float));
    std::memcpy(bytes.data() + 1 + 6 * sizeof(float), &last, sizeof last);
    const std::vector<std::byte> sent = bytes;
    upload.put(bytes, tensors);
    std::ranges::fill(bytes, std::byte{0});  // the caller's again
    Snapshot snapshot;
    snapshot.take(tensors);
    const std::span<const std::byte> there = snapshot.wait();
    EXPECT_TRUE(std::ranges::equal(there, sent));
    EXPECT_EQ(matrix[2][0].item<float>(), first + 2) << "the transposed tensor's columns are rows";
  }
  // Others than before: the staging memory grows.
  const Tensor larger = torch::zeros({1000}, on_device);
  bytes.assign(larger.nbytes(), std::byte{0x40});
  upload.put(bytes, {larger});
  Snapshot snapshot;
  snapshot.take({larger});
  EXPECT_TRUE(std::ranges::equal(snapshot.wait(), bytes));
}

}  // namespace upload_test
}  // namespace comrad::device
