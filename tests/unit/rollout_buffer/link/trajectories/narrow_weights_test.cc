// Weights in half of the bytes, for the way to other hosts.
#include "rollout_buffer/link/trajectories/weights_stream.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "rollout_buffer/core/rng.h"

namespace comrad::link {
namespace narrow_weights_test {

std::vector<std::byte> bytes_of(const std::vector<float>& parameters, const std::vector<double>& statistics) {
  std::vector<std::byte> bytes(parameters.size() * sizeof(float) + statistics.size() * sizeof(double));
  if (!parameters.empty()) std::memcpy(bytes.data(), parameters.data(), parameters.size() * sizeof(float));
  if (!statistics.empty())
    std::memcpy(bytes.data() + parameters.size() * sizeof(float), statistics.data(),
                statistics.size() * sizeof(double));
  return bytes;
}

/// What arrives of them at the other host.
std::vector<float> sent(const std::vector<float>& parameters) {
  std::vector<std::byte> narrow, wide;
  EXPECT_TRUE(narrow_weights(bytes_of(parameters, {}), parameters.size(), narrow));
  EXPECT_EQ(narrow.size(), parameters.size() * 2);
  EXPECT_TRUE(widen_weights(narrow, parameters.size(), wide));
  std::vector<float> arrived(parameters.size());
  EXPECT_EQ(wide.size(), arrived.size() * sizeof(float));
  std::memcpy(arrived.data(), wide.data(), wide.size());
  return arrived;
}

TEST(NarrowWeights, AreRoundedToTheNearestAndToEvenAtATie) {
  const float ulp = std::ldexp(1.0f, -7);  // of bfloat16 between 1 and 2
  EXPECT_EQ(sent({1, -1, 0, 1 + ulp, 1 + 0.49f * ulp, 1 + 0.51f * ulp}),
            (std::vector<float>{1, -1, 0, 1 + ulp, 1, 1 + ulp}));
  EXPECT_EQ(sent({1 + 0.5f * ulp, 1 + 1.5f * ulp, -1 - 0.5f * ulp}),
            (std::vector<float>{1, 1 + 2 * ulp, -1}));
  EXPECT_EQ(sent({2 - ulp / 4}), (std::vector<float>{2}));  // into the next exponent
}

TEST(NarrowWeights, KeepWhatIsNoNumber) {
  const float infinity = std::numeric_limits<float>::infinity();
  const std::vector<float> arrived =
      sent({infinity, -infinity, std::nanf(""), std::numeric_limits<float>::max()});
  EXPECT_EQ(arrived[0], infinity);
  EXPECT_EQ(arrived[1], -infinity);
  EXPECT_TRUE(std::isnan(arrived[2]));
  EXPECT_EQ(arrived[3], infinity);  // nearer than the largest bfloat16
  uint32_t bits = 0x7F800001;       // a NaN whose only bits are those that are cut off
  float nan = 0;
  std::memcpy(&nan, &bits, sizeof nan);
  EXPECT_TRUE(std::isnan(sent({nan})[0]));
}

TEST(NarrowWeights, ErrIn1Of256AtMostAndOnceOnly) {
  Rng rng(1);
  std::vector<float> parameters(5000);
  for (float& value : parameters) value = (static_cast<float>(rng.next() >> 40) / (1 << 24) - 0.5f) * 0.2f;
  const std::vector<float> arrived = sent(parameters);
  for (std::size_t i = 0; i < parameters.size(); ++i)
    ASSERT_LE(std::abs(arrived[i] - parameters[i]), std::abs(parameters[i]) / 256) << parameters[i];
  EXPECT_EQ(sent(arrived), arrived);
}

TEST(NarrowWeights, StatisticsBecomeFloats) {
  const std::vector<double> statistics = {0.1, 12345.678, 3e9};
  std::vector<std::byte> narrow, wide;
  ASSERT_TRUE(narrow_weights(bytes_of({0.5f, 0.25f, 0.125f}, statistics), 3, narrow));
  EXPECT_EQ(narrow.size(), 3 * 2 + 3 * 4u);
  ASSERT_TRUE(widen_weights(narrow, 3, wide));
  EXPECT_EQ(wide, bytes_of({0.5f, 0.25f, 0.125f}, {double{0.1f}, double{12345.678f}, 3e9}));
}

TEST(NarrowWeights, RefuseWhatCannotBeWeights) {
  std::vector<std::byte> out;
  const std::vector<std::byte> twelve(12);
  EXPECT_TRUE(narrow_weights(twelve, 1, out));
  EXPECT_TRUE(narrow_weights(twelve, 3, out));
  for (const uint64_t count : {uint64_t{2}, uint64_t{4}, ~uint64_t{0}, uint64_t{1} << 62}) {
    const Status narrowed = narrow_weights(twelve, count, out);
    ASSERT_FALSE(narrowed) << count;
    EXPECT_EQ(narrowed.error().code, ErrorCode::kBadFormat);
  }
  EXPECT_TRUE(widen_weights(twelve, 2, out));
  EXPECT_TRUE(widen_weights(twelve, 6, out));
  for (const uint64_t count : {uint64_t{1}, uint64_t{3}, uint64_t{7}, ~uint64_t{0}})
    EXPECT_FALSE(widen_weights(twelve, count, out)) << count;
}

}  // namespace narrow_weights_test
}  // namespace comrad::link
