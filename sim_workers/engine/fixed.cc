#include "sim_workers/engine/fixed.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

namespace comrad::doom {
namespace {

constexpr int kFineAngles = 8192;
constexpr int kFineQuadrant = kFineAngles / 4;
constexpr int kAngleToFineShift = 19;

// The table that the movement traces show: truncated, not rounded; the falling quadrants mirror the rising
// ones with the last entry first, so that sine(90 degrees + a) reads sine(90 degrees - a - 1 fine angle); the
// four axes exact. No product of the first quadrant lies within 1e-6 of an integer, so the last bit of
// std::sin cannot matter (tests/unit/sim_workers/fixed_test.cc keeps this true).
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

Fixed approximate_distance(int64_t dx, int64_t dy) {
  const int64_t x = std::abs(dx), y = std::abs(dy);
  return static_cast<Fixed>(std::min<int64_t>(x + y - std::min(x, y) / 2, INT32_MAX));
}

Angle angle_to(Fixed from_x, Fixed from_y, Fixed to_x, Fixed to_y) {
  const int64_t dx = int64_t{to_x} - from_x, dy = int64_t{to_y} - from_y;
  if (dx == 0 && dy == 0) return 0;
  // The first octant's arctangent by bisection over the sine table: the largest fine angle whose tangent does
  // not exceed the slope. Twelve steps, integers only.
  const int64_t large = std::max(std::abs(dx), std::abs(dy)), small = std::min(std::abs(dx), std::abs(dy));
  uint32_t low = 0, high = 1024;  // fine angles: 1024 are an eighth of a turn
  while (high - low > 1) {
    const uint32_t middle = (low + high) / 2;
    const int64_t sine = fine_sine(middle << 19), cosine = fine_cosine(middle << 19);
    if (sine * (large >> 8) <= cosine * (small >> 8)) {
      low = middle;
    } else {
      high = middle;
    }
  }
  if (small == large) low = 1024;
  // A quirk of Doom's octants: four of the eight end one short, those that hold due north and west among
  // them. A push due north goes by the fine angle below (measured).
  const Angle part = low << 19;
  const bool steep = std::abs(dy) >= std::abs(dx);
  Angle angle = 0;
  if (dx >= 0 && dy >= 0) {
    angle = steep ? kAngle90 - 1 - part : part;
  } else if (dx >= 0) {
    angle = steep ? kAngle180 + kAngle90 + part : 0u - part;
  } else if (dy >= 0) {
    angle = steep ? kAngle90 + part : kAngle180 - 1 - part;
  } else {
    angle = steep ? kAngle180 + kAngle90 - 1 - part : kAngle180 + part;
  }
  return angle;
}

}  // namespace comrad::doom
