#include "sim_workers/engine/fixed.h"

#include <array>
#include <cmath>

namespace comrad::doom {
namespace {

constexpr int kFineAngles = 8192;
constexpr int kFineQuadrant = kFineAngles / 4;
constexpr int kAngleToFineShift = 19;

// The table that the movement traces show: truncated, not rounded; the falling quadrants mirror the rising
// ones with the last entry first, so that sine(90 degrees + a) reads sine(90 degrees - a - 1 fine angle); the
// four axes exact. No product of the first quadrant lies within 1e-6 of an integer, so the last bit of
// std::sin cannot matter (tests/unit/sim_workers/play/fixed_test.cc keeps this true).
std::array<Fixed, kFineAngles> make_sine_table() {
  constexpr double kRadiansPerFineAngle = 6.283185307179586476925 / kFineAngles;
  std::array<Fixed, kFineAngles> table{};
  for (int i = 0; i < kFineQuadrant; ++i) {
    const Fixed sine = static_cast<Fixed>(std::sin(i * kRadiansPerFineAngle) * kFracUnit);
    table[i] = sine;
    table[2 * kFineQuadrant - 1 - i] = sine;
    table[2 * kFineQuadrant + i] = -sine;
    table[4 * kFineQuadrant - 1 - i] = -sine;
  }
  table[kFineQuadrant] = kFracUnit;
  table[3 * kFineQuadrant] = -kFracUnit;
  return table;
}

const std::array<Fixed, kFineAngles> kSineTable = make_sine_table();

}  // namespace

Fixed fine_sine(Angle angle) { return kSineTable[angle >> kAngleToFineShift]; }

Fixed fine_cosine(Angle angle) { return fine_sine(angle + kAngle90); }

}  // namespace comrad::doom
