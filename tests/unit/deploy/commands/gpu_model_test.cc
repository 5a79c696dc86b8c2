#include "deploy/commands/gpu_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace gpu_model_test {

using ::testing::HasSubstr;

CountedWork work(double flop, double bytes, double launches, double decisions_per_pass) {
  return {.flop = flop, .bytes = bytes, .launches = launches, .decisions_per_pass = decisions_per_pass};
}

DecisionCosts costs_of(Stage stage, double seconds) {
  DecisionCosts costs;
  costs.stage_s[static_cast<std::size_t>(stage)] = seconds;
  return costs;
}

TEST(GpuModel, KnowsItsGpus) {
  ASSERT_TRUE(peaks_of("h100"));
  EXPECT_EQ(peaks_of("h100")->bf16_flop_per_s, 989e12);
  EXPECT_THAT(peaks_of("h10").error().message, HasSubstr("h100"));
}

TEST(GpuModel, AStageTakesAsLongAsItsDearestPart) {
  const GpuPeaks gpu{"g", 1e12, 10e12, 1e9, 1e9};
  const GpuTime compute = gpu_time(work(1e9, 1e3, 10, 100), gpu, false);
  EXPECT_DOUBLE_EQ(compute.all_s(), 1e-3);
  EXPECT_STREQ(compute.bound(), "compute");
  EXPECT_DOUBLE_EQ(gpu_time(work(1e9, 1e3, 10, 100), gpu, true).all_s(), 1e-4) << "bf16";
  EXPECT_STREQ(gpu_time(work(1e3, 1e6, 10, 100), gpu, false).bound(), "memory");
  const GpuTime launches = gpu_time(work(1e3, 1e3, 200, 100), gpu, false);
  EXPECT_DOUBLE_EQ(launches.all_s(), 2 * kLaunchS);
  EXPECT_STREQ(launches.bound(), "launches");
}

TEST(GpuModel, TheSlowestPartSaturates) {
  const GpuPeaks gpu{"g", 1e12, 10e12, 1e12, 1e9};
  const auto row = [&](const DecisionCosts& costs, const CountedWork& policy, const CountedWork& learner,
                       double frame_bytes) {
    return gpu_row(gpu, 16, costs, policy, {learner, learner}, false, frame_bytes, 4);
  };
  const CountedWork little = work(1e3, 1e3, 1, 1000), much = work(1e9, 1e3, 1, 1000);
  auto found = row(costs_of(Stage::kTic, 1e-4), little, little, 1);
  EXPECT_EQ(found["saturates"], "cores");
  EXPECT_DOUBLE_EQ(found["decisions_per_s"].get<double>(), 160e3);
  EXPECT_DOUBLE_EQ(found["env_frames_per_s"].get<double>(), 640e3);
  found = row(costs_of(Stage::kTic, 1e-4), much, much, 1);
  EXPECT_EQ(found["saturates"], "GPU");
  EXPECT_NEAR(found["decisions_per_s"].get<double>(), 1000 / 3.0, 1e-6)
      << "forward, and two phases of an update";
  found = row(costs_of(Stage::kForward, 1e-4), work(1, 1, 100, 1), little, 1);
  EXPECT_EQ(found["saturates"], "launches of a policy worker") << "the processor's own forward pass is gone";
  found = row(costs_of(Stage::kForward, 1e-4), little, work(1, 1, 100, 1), 1);
  EXPECT_EQ(found["saturates"], "launches of the learner");
  found = row(costs_of(Stage::kForward, 1e-4), little, little, 1e6);
  EXPECT_EQ(found["saturates"], "bus");
  EXPECT_DOUBLE_EQ(found["decisions_per_s"].get<double>(), 500);
}

TEST(GpuModel, CountedWorkIsReadWithCare) {
  const auto counted = CountedWork::from({{"flop_per_decision", 2},
                                          {"bytes_per_decision", 3},
                                          {"launches_per_pass", 4},
                                          {"decisions_per_pass", 5}});
  ASSERT_TRUE(counted);
  EXPECT_EQ(counted->launches, 4);
  EXPECT_THAT(CountedWork::from({{"flop_per_decision", 2}}).error().message, HasSubstr("bytes_per_decision"));
  EXPECT_FALSE(CountedWork::from(nullptr));
}

}  // namespace gpu_model_test
}  // namespace comrad::deploy
