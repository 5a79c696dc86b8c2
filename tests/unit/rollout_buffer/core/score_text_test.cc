#include "rollout_buffer/core/score_text.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace comrad {
namespace score_text_test {

TEST(ScoreText, HasFourDigitsWhateverTheScale) {
  EXPECT_EQ(score_text(0), "0");
  EXPECT_EQ(score_text(-0.0), "0");
  EXPECT_EQ(score_text(3), "3");
  EXPECT_EQ(score_text(412.34), "412.3");
  EXPECT_EQ(score_text(-16.1179), "-16.12");
  EXPECT_EQ(score_text(9999.4), "9999");
  EXPECT_EQ(score_text(12345.6), "12346") << "no exponent";
  EXPECT_EQ(score_text(0.000123456), "0.0001235");
  EXPECT_EQ(score_text(std::nan("")), "-");
  EXPECT_EQ(score_text(std::numeric_limits<double>::max()).size(), 309u);
}

}  // namespace score_text_test
}  // namespace comrad
