#include "rollout_buffer/core/score_text.h"

#include <array>
#include <cmath>
#include <cstdio>

namespace comrad {

std::string score_text(double score) {
  if (!std::isfinite(score)) return "-";
  std::array<char, 400> text{};  // takes any double
  // No exponent for a large score, and no "-0".
  std::snprintf(text.data(), text.size(), std::fabs(score) < 9999.5 ? "%.4g" : "%.0f",
                score == 0 ? 0.0 : score);
  return text.data();
}

}  // namespace comrad
