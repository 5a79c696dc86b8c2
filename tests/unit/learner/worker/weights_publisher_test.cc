#include "learner/worker/weights_publisher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include "policy_workers/device/readback.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace weights_publisher_test {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

/// Its version is its only weight.
class Counted : public Algorithm {
 public:
  void step() { weight_.fill_(static_cast<int32_t>(++version_)); }

  PolicyVersion version() const override { return version_; }
  int64_t parameter_count() const override { return 1; }
  std::vector<torch::Tensor> weight_tensors() const override { return {weight_}; }
  int64_t weights_bytes() const override { return static_cast<int64_t>(weight_.nbytes()); }
  std::vector<std::byte> weights() const override { return {}; }
  void append_diagnostics(NamedNumbers&) const override {}
  void save(StateDict&) const override {}
  Status load(const StateDict&) override { return {}; }

 private:
  PolicyVersion version_ = 0;
  torch::Tensor weight_ = torch::zeros({1}, torch::kInt32);
};

class WeightsPublisherTest : public ::testing::Test {
 protected:
  Counted algorithm_;
  std::vector<std::pair<PolicyVersion, int32_t>> published_;  ///< and the weight that came with it
  WeightsPublisher publisher_{algorithm_, [this](std::span<const std::byte> weights, PolicyVersion version) {
                                int32_t weight = 0;
                                ASSERT_EQ(weights.size(), sizeof weight);
                                std::memcpy(&weight, weights.data(), sizeof weight);
                                published_.emplace_back(version, weight);
                              }};
};

TEST_F(WeightsPublisherTest, PublishesAtOnceOnACpu) {
  publisher_.deliver();
  EXPECT_THAT(published_, IsEmpty()) << "nothing was offered";
  publisher_.offer();
  algorithm_.step();
  publisher_.deliver();
  EXPECT_THAT(published_, ElementsAre(Pair(0, 0))) << "the new one was not offered";
  publisher_.offer();
  publisher_.finish();
  EXPECT_THAT(published_, ElementsAre(Pair(0, 0), Pair(1, 1)));
}

TEST_F(WeightsPublisherTest, DoesNotWaitForADeviceAndSkipsWhatHasANewerOneBehindIt) {
  const device::SlowReadbacks slow;
  for (int step = 0; step < 3; ++step) {
    algorithm_.step();
    publisher_.offer();
    publisher_.deliver();
  }
  EXPECT_THAT(published_, IsEmpty());
  publisher_.finish();
  EXPECT_THAT(published_, ElementsAre(Pair(1, 1), Pair(3, 3)));
}

TEST_F(WeightsPublisherTest, AnIntervalPassesBetweenTwoUnlessTheyAreTheLast) {
  WeightsPublisher patient(
      algorithm_,
      [this](std::span<const std::byte>, PolicyVersion version) { published_.emplace_back(version, 0); },
      /*interval_s=*/1e9);
  for (int step = 0; step < 3; ++step) {
    algorithm_.step();
    patient.offer();
    patient.deliver();
  }
  EXPECT_THAT(published_, ElementsAre(Pair(1, 0)));
  patient.finish();
  EXPECT_THAT(published_, ElementsAre(Pair(1, 0), Pair(3, 0)));
}

}  // namespace weights_publisher_test
}  // namespace comrad::learn
