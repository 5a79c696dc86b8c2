#include "deploy/evaluation/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace comrad::deploy {
namespace statistics_test {

TEST(StudentT975, MatchesTheTables) {  // NIST/SEMATECH e-Handbook, table 1.3.6.7.2
  EXPECT_NEAR(student_t_975(1), 12.706, 5e-4);
  EXPECT_NEAR(student_t_975(2), 4.303, 5e-4);
  EXPECT_NEAR(student_t_975(3), 3.182, 5e-4);
  EXPECT_NEAR(student_t_975(4), 2.776, 5e-4);
  EXPECT_NEAR(student_t_975(9), 2.262, 5e-4);
  EXPECT_NEAR(student_t_975(10), 2.228, 5e-4);
  EXPECT_NEAR(student_t_975(30), 2.042, 5e-4);
  EXPECT_NEAR(student_t_975(99), 1.984, 5e-4);
  EXPECT_NEAR(student_t_975(100000), 1.960, 5e-4);
}

TEST(Confidence95, IsTheTextbookHalfWidth) {
  // 1 2 3 4 5: s = sqrt(2.5), n = 5, t(0.975, 4) = 2.776445.
  const std::vector<double> values = {1, 2, 3, 4, 5};
  EXPECT_DOUBLE_EQ(mean(values), 3);
  EXPECT_NEAR(confidence_95(values), 2.776445 * std::sqrt(2.5 / 5), 1e-5);
}

TEST(Confidence95, IsNothingForFewerThanTwoValues) {
  EXPECT_TRUE(std::isnan(confidence_95(std::vector<double>{})));
  EXPECT_TRUE(std::isnan(confidence_95(std::vector<double>{3})));
  EXPECT_TRUE(std::isnan(mean(std::vector<double>{})));
}

TEST(Confidence95, IsZeroForEqualValues) { EXPECT_EQ(confidence_95(std::vector<double>{2, 2, 2}), 0); }

}  // namespace statistics_test
}  // namespace comrad::deploy
