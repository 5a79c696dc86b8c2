#include "rollout_buffer/schema/slab_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace comrad {
namespace slab_check_test {

using ::testing::ElementsAre;

EnvShape two_heads() {
  EnvShape env{
      .num_agents = 1, .channels = 1, .height = 1, .width = 1, .measurement_count = 0, .head_count = 2};
  env.head_sizes = {3, 2};
  return env;
}

TEST(SlabCheck, FloatsThatAreNotFiniteBecomeZeros) {
  std::vector<float> target(3, 9.0f);
  EXPECT_TRUE(take_floats(std::vector<float>{1, -2, 3}, target.data()));
  EXPECT_THAT(target, ElementsAre(1, -2, 3));
  for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
    EXPECT_FALSE(take_floats(std::vector<float>{1, bad, 3}, target.data()));
    EXPECT_THAT(target, ElementsAre(0, 0, 0));
  }
  EXPECT_TRUE(take_floats(std::vector<float>{}, nullptr));
}

TEST(SlabCheck, AMaskIsOnesAndZerosAndAllowsSomethingInEveryHead) {
  std::vector<uint8_t> target(5, 9);
  EXPECT_TRUE(take_mask(two_heads(), std::vector<uint8_t>{0, 7, 0, 255, 0}, target.data()));
  EXPECT_THAT(target, ElementsAre(0, 1, 0, 1, 0));
  EXPECT_FALSE(take_mask(two_heads(), std::vector<uint8_t>{1, 1, 0, 0, 0}, target.data()));
  EXPECT_THAT(target, ElementsAre(1, 1, 1, 1, 1));
}

TEST(SlabCheck, AnActionOutsideItsHeadBecomesZero) {
  std::array<int64_t, 2> wide{9, 9};
  std::array<uint8_t, 2> narrow{9, 9};
  EXPECT_TRUE(take_action(two_heads(), std::vector<int32_t>{2, 1}, wide.data()));
  EXPECT_THAT(wide, ElementsAre(2, 1));
  for (const int32_t bad : {-1, 2, 1 << 30}) {
    EXPECT_FALSE(take_action(two_heads(), std::vector<int32_t>{1, bad}, narrow.data())) << bad;
    EXPECT_THAT(narrow, ElementsAre(1, 0));
  }
}

TEST(SlabCheck, AFinalRowIsReadWhereAnEpisodeWasCutAlone) {
  TrajectoryShape shape;
  shape.env = two_heads();
  shape.rollout_steps = 1;
  shape.final_capacity = 4;
  const SlabOffsets offsets(shape);
  std::vector<std::byte> bytes(static_cast<std::size_t>(offsets.slab_bytes));
  const SlabView slab(offsets, bytes.data());
  const auto end = [&](int32_t row, bool terminated, bool truncated) {
    slab.final_index(0) = row;
    slab.terminated(0) = terminated ? 200 : 0;
    slab.truncated(0) = truncated;
    return take_end(slab, 0);
  };
  EXPECT_TRUE(end(-1, false, false).is_sound);
  EXPECT_TRUE(end(-1, true, false).is_terminated);
  EXPECT_EQ(end(3, false, true).final_row, 3);
  EXPECT_TRUE(end(3, false, true).is_sound);
  EXPECT_EQ(end(2, true, false).final_row, -1) << "nothing bootstraps from a terminated step";
  EXPECT_TRUE(end(2, true, false).is_sound);
  EXPECT_FALSE(end(-1, false, true).is_sound) << "a cut episode has a last observation";
  for (const int32_t row : {4, -2, std::numeric_limits<int32_t>::max()}) {
    EXPECT_FALSE(end(row, false, true).is_sound) << row;
    EXPECT_FALSE(end(row, false, false).is_sound) << row;
    EXPECT_EQ(end(row, false, true).final_row, -1) << row;
  }
}

}  // namespace slab_check_test
}  // namespace comrad
