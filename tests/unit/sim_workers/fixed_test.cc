#include "sim_workers/engine/fixed.h"

#include <gtest/gtest.h>

#include <cmath>

namespace comrad::doom {
namespace fixed_test {

TEST(Fixed, MultipliesTowardsMinusInfinityAndDividesTowardsZero) {
  EXPECT_EQ(fixed_mul(to_fixed(3), to_fixed(-2)), to_fixed(-6));
  EXPECT_EQ(fixed_mul(-1, kFracUnit / 2), -1);
  EXPECT_EQ(fixed_mul(1, kFracUnit / 2), 0);
  EXPECT_EQ(fixed_div(to_fixed(-3), to_fixed(2)), -3 * kFracUnit / 2);
  EXPECT_EQ(fixed_div(to_fixed(20000), 1), INT32_MAX);
  EXPECT_EQ(fixed_div(to_fixed(-20000), 1), INT32_MIN);
  EXPECT_EQ(fixed_div(-1, 0), INT32_MIN);
}

TEST(FineSine, TheFourAxesAreExact) {
  EXPECT_EQ(fine_sine(0), 0);
  EXPECT_EQ(fine_sine(kAngle90), kFracUnit);
  EXPECT_EQ(fine_sine(kAngle180), 0);
  EXPECT_EQ(fine_sine(kAngle180 + kAngle90), -kFracUnit);
  EXPECT_EQ(fine_cosine(0), kFracUnit);
  EXPECT_EQ(fine_cosine(kAngle180), -kFracUnit);
}

TEST(FineSine, IsTheSineTruncatedToWithinOneFineAngle) {
  for (uint32_t fine = 0; fine < 8192; ++fine) {
    const double exact = std::sin(fine * 2 * M_PI / 8192) * kFracUnit;
    EXPECT_NEAR(fine_sine(fine << 19), exact, 2 * M_PI / 8192 * kFracUnit + 1) << fine;
  }
  // Values that the movement traces fix: 40 fine angles and the cosine of the same angle.
  EXPECT_EQ(fine_sine(40u << 19), 2010);
  EXPECT_EQ(fine_cosine(40u << 19), 65503);
}

TEST(FineSine, NoTableEntryHangsOnTheLastBitOfTheLibrarysSine) {
  for (int fine = 1; fine < 2048; ++fine) {
    const double exact = std::sin(fine * 2 * M_PI / 8192) * kFracUnit;
    EXPECT_GT(std::abs(exact - std::round(exact)), 1e-6) << fine;
  }
}

TEST(Angle, WholeDegreesWrap) {
  EXPECT_EQ(degrees_to_angle(90), kAngle90);
  EXPECT_EQ(degrees_to_angle(360), 0u);
  EXPECT_EQ(degrees_to_angle(-90), kAngle180 + kAngle90);
}

}  // namespace fixed_test
}  // namespace comrad::doom
