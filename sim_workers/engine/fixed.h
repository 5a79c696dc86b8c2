// Doom's numbers: 16.16 fixed point and 32-bit binary angles. Integer arithmetic only, so that a world is the
// same on every machine.
#pragma once

#include <cstdint>

namespace comrad::doom {

using Fixed = int32_t;   ///< 16.16
using Angle = uint32_t;  ///< 2^32 = one turn, 0 = east, counter-clockwise

constexpr int kFracBits = 16;
constexpr Fixed kFracUnit = 1 << kFracBits;
constexpr Angle kAngle45 = 0x20000000u;
constexpr Angle kAngle90 = 0x40000000u;
constexpr Angle kAngle180 = 0x80000000u;

constexpr Fixed to_fixed(int value) { return static_cast<Fixed>(static_cast<uint32_t>(value) << kFracBits); }
constexpr Fixed fixed_mul(Fixed a, Fixed b) { return static_cast<Fixed>((int64_t{a} * b) >> kFracBits); }
/// a / b, saturated where the quotient does not fit.
constexpr Fixed fixed_div(Fixed a, Fixed b) {
  if (b == 0) return a < 0 ? INT32_MIN : INT32_MAX;
  const int64_t quotient = (int64_t{a} << kFracBits) / b;
  return quotient > INT32_MAX ? INT32_MAX : quotient < INT32_MIN ? INT32_MIN : static_cast<Fixed>(quotient);
}
/// A value kept inside the number range; never INT32_MIN, so that it may change its sign.
constexpr Fixed clamped_fixed(int64_t value) {
  return value > INT32_MAX ? INT32_MAX : value <= INT32_MIN ? INT32_MIN + 1 : static_cast<Fixed>(value);
}
constexpr double to_double(Fixed value) { return value / 65536.0; }
constexpr float to_float(Fixed value) { return static_cast<float>(value) * (1.0f / 65536.0f); }
constexpr Angle degrees_to_angle(int degrees) {
  return static_cast<Angle>((static_cast<int64_t>(degrees) << 32) / 360);
}
constexpr double angle_to_radians(Angle angle) { return angle * (6.283185307179586 / 4294967296.0); }

/// Sine and cosine of an angle as 16.16, from a table of 8192 fine angles, truncated as the engine's own; the
/// same on every machine.
Fixed fine_sine(Angle angle);
Fixed fine_cosine(Angle angle);

/// Distance of two points as Doom estimates it: the longer axis plus half of the shorter one. Two points of a map
/// may be further apart than a Fixed can say; the result is cut off there.
Fixed approximate_distance(int64_t dx, int64_t dy);
/// The angle from one point to another, from an arctangent table: the same on every machine.
Angle angle_to(Fixed from_x, Fixed from_y, Fixed to_x, Fixed to_y);

}  // namespace comrad::doom
