// Plane geometry on whole map units: polygons, regions with holes, clearances, and sines without a maths
// library. Every function is integer arithmetic, so that the same seed draws the same map on every machine.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "rollout_buffer/core/rng.h"

namespace comrad::doomgen {

constexpr int32_t kMaxCoordinate = 16384;  ///< maps stay inside +- this

/// A place on the map in whole units; y grows to the north.
struct Point {
  int32_t x = 0, y = 0;
  friend bool operator==(const Point&, const Point&) = default;
  friend auto operator<=>(const Point&, const Point&) = default;
};

/// A closed loop of corners; the last one joins the first. Either turning sense.
using Polygon = std::vector<Point>;

/// A polygon with pieces cut out of it; the pieces lie inside and apart from each other.
struct Region {
  Polygon outline;
  std::vector<Polygon> holes;
};

/// An axis-aligned rectangle, both edges included.
struct Box {
  Point low, high;
  /// The rectangle of that size around `centre` (odd sizes: the greater half to the north-east).
  static Box around(Point centre, int32_t width, int32_t height) {
    const Point low{centre.x - width / 2, centre.y - height / 2};
    return {low, {low.x + width, low.y + height}};
  }
  Polygon polygon() const;          ///< its four corners, counter-clockwise
  Box grown(int32_t margin) const;  ///< pushed out by `margin` on every side
};

/// Twice the signed area of triangle a, b, c: positive where c lies to the left of a -> b.
constexpr int64_t cross(Point a, Point b, Point c) {
  return int64_t{b.x - a.x} * (c.y - a.y) - int64_t{b.y - a.y} * (c.x - a.x);
}

/// Twice the signed area of a polygon: positive where it turns counter-clockwise.
int64_t twice_area(std::span<const Point> polygon);

/// Square of the distance between two points.
constexpr int64_t distance_squared(Point a, Point b) {
  return int64_t{a.x - b.x} * (a.x - b.x) + int64_t{a.y - b.y} * (a.y - b.y);
}

/// True where `p` is nearer than `radius` to the segment a-b.
bool nearer_than(Point p, Point a, Point b, int32_t radius);

/// True where the two segments have any point in common, ends included.
bool segments_touch(Point a, Point b, Point c, Point d);

/// True where the segment a-b has a point strictly inside `box`; sliding along its edge does not count.
bool crosses_box(Point a, Point b, const Box& box);

/// True where `p` is inside (crossing parity; points on the outline may go either way).
bool inside(std::span<const Point> polygon, Point p);

/// True where `p` is inside the region and at least `clearance` from its outline and holes.
bool clear_inside(const Region& region, Point p, int32_t clearance);

/// True where all of `box`, and a margin of `gap` around it, lies inside the region and touches none of
/// its edges.
bool clear_inside(const Region& region, const Box& box, int32_t gap);

Box bounds_of(std::span<const Point> points);

/// A uniform whole-unit point of the region with the clearance, or nothing after `tries` draws of its bounds.
std::optional<Point> random_point(const Region& region, int32_t clearance, Rng& rng, int tries = 4096);

/// Sine and cosine of numerator/denominator turns, scaled by 2^30; error below 2^-27.
struct SineCosine {
  int64_t sine = 0, cosine = 0;
};
SineCosine sine_cosine_of_turn(int64_t numerator, int64_t denominator);

/// The point at `radius` and numerator/denominator turns (counter-clockwise from east) from the
/// origin, rounded.
Point polar_point(int32_t radius, int64_t numerator, int64_t denominator);

/// The whole degree (0 east, 90 north) in which `to` lies from `from`; 0 where they coincide.
int32_t degrees_towards(Point from, Point to);

}  // namespace comrad::doomgen
