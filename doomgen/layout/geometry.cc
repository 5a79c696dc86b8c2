#include "doomgen/layout/geometry.h"

#include <algorithm>

#include "rollout_buffer/core/check.h"

namespace comrad::doomgen {
namespace {

constexpr int64_t kOne = int64_t{1} << 30;

int sign_of(int64_t value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }

bool inside_bounds(Point p, Point a, Point b) {
  return p.x >= std::min(a.x, b.x) && p.x <= std::max(a.x, b.x) && p.y >= std::min(a.y, b.y) &&
         p.y <= std::max(a.y, b.y);
}

template <typename Visitor>
bool any_edge(const Polygon& polygon, Visitor&& visitor) {
  for (std::size_t i = 0; i < polygon.size(); ++i)
    if (visitor(polygon[i], polygon[(i + 1) % polygon.size()])) return true;
  return false;
}

template <typename Visitor>
bool any_edge(const Region& region, Visitor&& visitor) {
  if (any_edge(region.outline, visitor)) return true;
  for (const Polygon& hole : region.holes)
    if (any_edge(hole, visitor)) return true;
  return false;
}

bool inside_region(const Region& region, Point p) {
  if (!inside(region.outline, p)) return false;
  for (const Polygon& hole : region.holes)
    if (inside(hole, p)) return false;
  return true;
}

/// Nearest whole number to value / 2^30, halves upwards.
int32_t round_scaled(int64_t value) { return static_cast<int32_t>((value + kOne / 2) >> 30); }

}  // namespace

Polygon Box::polygon() const { return {low, {high.x, low.y}, high, {low.x, high.y}}; }

Box Box::grown(int32_t margin) const {
  return {{low.x - margin, low.y - margin}, {high.x + margin, high.y + margin}};
}

int64_t twice_area(std::span<const Point> polygon) {
  int64_t sum = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point a = polygon[i], b = polygon[(i + 1) % polygon.size()];
    sum += int64_t{a.x} * b.y - int64_t{a.y} * b.x;
  }
  return sum;
}

bool nearer_than(Point p, Point a, Point b, int32_t radius) {
  const int64_t limit = int64_t{radius} * radius;
  const int64_t length_squared = distance_squared(a, b);
  const int64_t along = int64_t{p.x - a.x} * (b.x - a.x) + int64_t{p.y - a.y} * (b.y - a.y);
  if (along <= 0) return distance_squared(p, a) < limit;
  if (along >= length_squared) return distance_squared(p, b) < limit;
  // distance = |cross| / length, compared as squares; 128 bits because squares of areas reach 2^64.
  const __int128 area = cross(a, b, p);
  return area * area < static_cast<__int128>(limit) * length_squared;
}

bool segments_touch(Point a, Point b, Point c, Point d) {
  const int c_side = sign_of(cross(a, b, c)), d_side = sign_of(cross(a, b, d));
  const int a_side = sign_of(cross(c, d, a)), b_side = sign_of(cross(c, d, b));
  if (c_side * d_side < 0 && a_side * b_side < 0) return true;
  return (c_side == 0 && inside_bounds(c, a, b)) || (d_side == 0 && inside_bounds(d, a, b)) ||
         (a_side == 0 && inside_bounds(a, c, d)) || (b_side == 0 && inside_bounds(b, c, d));
}

bool crosses_box(Point a, Point b, const Box& box) {
  if (std::max(a.x, b.x) <= box.low.x || std::min(a.x, b.x) >= box.high.x ||
      std::max(a.y, b.y) <= box.low.y || std::min(a.y, b.y) >= box.high.y)
    return false;
  // The line separates the box from itself only if its corners lie strictly on both sides.
  const int first = sign_of(cross(a, b, box.low)), second = sign_of(cross(a, b, {box.high.x, box.low.y}));
  const int third = sign_of(cross(a, b, box.high)), fourth = sign_of(cross(a, b, {box.low.x, box.high.y}));
  const int high = std::max({first, second, third, fourth}), low = std::min({first, second, third, fourth});
  return high > 0 && low < 0;
}

bool inside(std::span<const Point> polygon, Point p) {
  bool is_inside = false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point a = polygon[i], b = polygon[(i + 1) % polygon.size()];
    if ((a.y > p.y) == (b.y > p.y)) continue;
    // The edge crosses the ray to the east when p lies to the left of the edge taken upwards.
    if (a.y < b.y ? cross(a, b, p) > 0 : cross(a, b, p) < 0) is_inside = !is_inside;
  }
  return is_inside;
}

bool clear_inside(const Region& region, Point p, int32_t clearance) {
  if (!inside_region(region, p)) return false;
  return !any_edge(region, [&](Point a, Point b) { return nearer_than(p, a, b, clearance); });
}

bool clear_inside(const Region& region, const Box& box, int32_t gap) {
  const Box grown = box.grown(gap);
  const Point centre{box.low.x + (box.high.x - box.low.x) / 2, box.low.y + (box.high.y - box.low.y) / 2};
  if (!inside_region(region, centre)) return false;
  return !any_edge(region, [&](Point a, Point b) { return crosses_box(a, b, grown); });
}

Box bounds_of(std::span<const Point> points) {
  COMRAD_CHECK(!points.empty(), "bounds need at least one point");
  Box box{points[0], points[0]};
  for (const Point& p : points) {
    box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y)};
    box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y)};
  }
  return box;
}

std::optional<Point> random_point(const Region& region, int32_t clearance, Rng& rng, int tries) {
  const Box bounds = bounds_of(region.outline);
  for (int i = 0; i < tries; ++i) {
    const int32_t x = rng.between(bounds.low.x, bounds.high.x);
    const int32_t y = rng.between(bounds.low.y, bounds.high.y);
    if (clear_inside(region, Point{x, y}, clearance)) return Point{x, y};
  }
  return std::nullopt;
}

SineCosine sine_cosine_of_turn(int64_t numerator, int64_t denominator) {
  COMRAD_CHECK(denominator > 0 && denominator < (int64_t{1} << 20),
               "turns are fractions with a small denominator");
  int64_t rest = numerator % denominator;
  if (rest < 0) rest += denominator;
  const int64_t quadrant = 4 * rest / denominator;
  const int64_t within = 4 * rest - quadrant * denominator;  // [0, denominator): part of a quarter turn
  // Taylor series at 2^30 scale; the angle is below pi/2, so twelve terms leave less than one unit of error.
  constexpr int64_t kHalfPi = 1686629713;  // pi / 2 * 2^30, rounded
  const int64_t angle = (kHalfPi * within + denominator / 2) / denominator;
  const int64_t square = (angle * angle) >> 30;
  int64_t sine = 0, cosine = 0, sine_term = angle, cosine_term = kOne;
  for (int64_t k = 0; k < 12; ++k) {
    sine += sine_term;
    cosine += cosine_term;
    sine_term = -((sine_term * square) >> 30) / ((2 * k + 2) * (2 * k + 3));
    cosine_term = -((cosine_term * square) >> 30) / ((2 * k + 1) * (2 * k + 2));
  }
  switch (quadrant) {
    case 0:
      return {sine, cosine};
    case 1:
      return {cosine, -sine};
    case 2:
      return {-sine, -cosine};
    default:
      return {-cosine, sine};
  }
}

Point polar_point(int32_t radius, int64_t numerator, int64_t denominator) {
  const SineCosine turn = sine_cosine_of_turn(numerator, denominator);
  return {round_scaled(radius * turn.cosine), round_scaled(radius * turn.sine)};
}

int32_t degrees_towards(Point from, Point to) {
  const int64_t dx = to.x - from.x, dy = to.y - from.y;
  int32_t best = 0;
  int64_t best_dot = 0;
  for (int32_t degrees = 0; degrees < 360; ++degrees) {
    const SineCosine turn = sine_cosine_of_turn(degrees, 360);
    const int64_t dot = dx * turn.cosine + dy * turn.sine;  // greatest where the directions agree
    if (dot > best_dot) best_dot = dot, best = degrees;
  }
  return best;
}

}  // namespace comrad::doomgen
