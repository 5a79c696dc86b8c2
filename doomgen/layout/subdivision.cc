#include "doomgen/layout/subdivision.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <map>
#include <utility>

namespace comrad::doomgen {
namespace {

constexpr int kRounds = 16;  // each moves corners by less than a unit; two or three suffice

/// An undirected edge: low before high.
struct Segment {
  Point low, high;
  friend bool operator==(const Segment&, const Segment&) = default;
  friend auto operator<=>(const Segment&, const Segment&) = default;
};

Segment segment_of(Point a, Point b) { return a < b ? Segment{a, b} : Segment{b, a}; }

/// A shape's outline as it is cut further and further.
struct Ring {
  std::vector<Point> corners;
  int owner = 0;
  bool only_rock = false;
  Box bounds;
};

int64_t rounded_ratio(__int128 numerator, __int128 denominator) {
  if (denominator < 0) numerator = -numerator, denominator = -denominator;
  const __int128 doubled = 2 * numerator + denominator, divisor = 2 * denominator;
  __int128 quotient = doubled / divisor;
  if (doubled % divisor != 0 && doubled < 0) --quotient;
  return static_cast<int64_t>(quotient);
}

/// Where two segments that cross in their insides meet, rounded to whole units.
Point crossing(const Segment& first, const Segment& second) {
  const Point a = first.low, b = first.high, c = second.low, d = second.high;
  const __int128 along = cross(c, d, a);  // a + (b - a) * along / whole
  const __int128 whole = along - cross(c, d, b);
  return {static_cast<int32_t>(a.x + rounded_ratio(along * (b.x - a.x), whole)),
          static_cast<int32_t>(a.y + rounded_ratio(along * (b.y - a.y), whole))};
}

bool within(Point p, const Segment& segment) {
  const auto [low_y, high_y] = std::minmax(segment.low.y, segment.high.y);
  return p.x >= segment.low.x && p.x <= segment.high.x && p.y >= low_y && p.y <= high_y;
}

using Cuts = std::map<Segment, std::vector<Point>>;

void cut(Cuts& cuts, const Segment& segment, Point p) {
  if (p != segment.low && p != segment.high) cuts[segment].push_back(p);
}

/// The places where the segments have to be cut so that they meet in their ends alone.
Cuts find_cuts(const std::vector<Segment>& segments) {
  Cuts cuts;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& first = segments[i];
    const auto [first_low, first_high] = std::minmax(first.low.y, first.high.y);
    for (std::size_t j = i + 1; j < segments.size(); ++j) {
      const Segment& second = segments[j];
      if (second.low.x > first.high.x + 1) break;  // sorted by x: no later one touches
      const auto [second_low, second_high] = std::minmax(second.low.y, second.high.y);
      if (second_low > first_high + 1 || second_high < first_low - 1) continue;
      bool met = false;
      const auto corner = [&](Point p, const Segment& other) {
        if (p == other.low || p == other.high) {
          met = true;
        } else if ((cross(other.low, other.high, p) == 0 && within(p, other)) ||
                   nearer_than(p, other.low, other.high, 1)) {
          cut(cuts, other, p);
          met = true;
        }
      };
      corner(second.low, first);
      corner(second.high, first);
      corner(first.low, second);
      corner(first.high, second);
      if (met || !segments_touch(first.low, first.high, second.low, second.high)) continue;
      const Point p = crossing(first, second);
      cut(cuts, first, p);
      cut(cuts, second, p);
    }
  }
  return cuts;
}

/// Puts the cuts into an outline, in the order in which it passes them.
std::vector<Point> refined(const std::vector<Point>& corners, const Cuts& cuts) {
  std::vector<Point> result;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Point start = corners[i], end = corners[(i + 1) % corners.size()];
    result.push_back(start);
    const auto found = cuts.find(segment_of(start, end));
    if (found == cuts.end()) continue;
    // Ordered from the segment's low end, so that every outline agrees; ties by the point itself.
    std::vector<Point> points = found->second;
    const Segment& segment = found->first;
    std::sort(points.begin(), points.end(), [&](Point a, Point b) {
      const auto along = [&](Point p) {
        return int64_t{p.x - segment.low.x} * (segment.high.x - segment.low.x) +
               int64_t{p.y - segment.low.y} * (segment.high.y - segment.low.y);
      };
      return along(a) != along(b) ? along(a) < along(b) : a < b;
    });
    points.erase(std::unique(points.begin(), points.end()), points.end());
    if (start != segment.low) std::reverse(points.begin(), points.end());
    for (const Point& p : points)
      if (p != result.back()) result.push_back(p);
  }
  while (result.size() > 1 && result.front() == result.back()) result.pop_back();
  return result;
}

/// Like inside(), for a point in sixteenths of a unit.
bool inside_fine(const std::vector<Point>& corners, Point p) {
  bool is_inside = false;
  Point a{corners.back().x * 16, corners.back().y * 16};
  for (const Point& corner : corners) {
    const Point b{corner.x * 16, corner.y * 16};
    if ((a.y > p.y) != (b.y > p.y) && (a.y < b.y ? cross(a, b, p) > 0 : cross(a, b, p) < 0))
      is_inside = !is_inside;
    a = b;
  }
  return is_inside;
}

int owner_at_fine(const std::vector<Ring>& rings, Point p) {
  int owner = -1;
  for (const Ring& ring : rings) {
    if (ring.only_rock && owner >= 0) continue;
    if (p.x < ring.bounds.low.x * 16 || p.x > ring.bounds.high.x * 16 || p.y < ring.bounds.low.y * 16 ||
        p.y > ring.bounds.high.y * 16)
      continue;
    if (inside_fine(ring.corners, p)) owner = ring.owner;
  }
  return owner;
}

}  // namespace

std::vector<PlaneEdge> subdivide(std::span<const Shape> shapes) {
  std::vector<Ring> rings;
  for (const Shape& shape : shapes)
    if (shape.outline.size() >= 3) rings.push_back({shape.outline, shape.owner, shape.only_rock, {}});
  std::vector<Segment> segments;
  for (int round = 0; round < kRounds; ++round) {
    segments.clear();
    for (const Ring& ring : rings)
      for (std::size_t i = 0; i < ring.corners.size(); ++i) {
        const Point a = ring.corners[i], b = ring.corners[(i + 1) % ring.corners.size()];
        if (a != b) segments.push_back(segment_of(a, b));
      }
    std::sort(segments.begin(), segments.end());
    segments.erase(std::unique(segments.begin(), segments.end()), segments.end());
    const Cuts cuts = find_cuts(segments);
    if (cuts.empty()) break;
    for (Ring& ring : rings) ring.corners = refined(ring.corners, cuts);
  }
  for (Ring& ring : rings) ring.bounds = bounds_of(ring.corners);

  std::vector<PlaneEdge> edges;
  for (const Segment& segment : segments) {
    const Point a = segment.low, b = segment.high;
    // An eighth of a unit beside the middle: no foreign corner comes so near.
    const Point middle{8 * (a.x + b.x), 8 * (a.y + b.y)};
    const int32_t dx = b.x - a.x, dy = b.y - a.y;
    const Point right = std::abs(dy) >= std::abs(dx) ? Point{dy > 0 ? 2 : -2, 0} : Point{0, dx > 0 ? -2 : 2};
    const int on_right = owner_at_fine(rings, {middle.x + right.x, middle.y + right.y});
    const int on_left = owner_at_fine(rings, {middle.x - right.x, middle.y - right.y});
    if (on_right == on_left || (on_right < 0 && on_left < 0)) continue;
    // The side that is an area, or the one with the lower number, is the right one.
    if (on_left >= 0 && (on_right < 0 || on_left < on_right))
      edges.push_back({b, a, on_left, on_right});
    else
      edges.push_back({a, b, on_right, on_left});
  }
  return join_straight(std::move(edges));
}

int owner_at(std::span<const Shape> shapes, Point p) {
  int owner = -1;
  for (const Shape& shape : shapes)
    if ((!shape.only_rock || owner < 0) && inside(shape.outline, p)) owner = shape.owner;
  return owner;
}

std::vector<PlaneEdge> join_straight(std::vector<PlaneEdge> edges) {
  std::map<Point, std::vector<std::size_t>> at_corner;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    at_corner[edges[i].start].push_back(i);
    at_corner[edges[i].end].push_back(i);
  }
  std::vector<bool> gone(edges.size());
  for (auto& [corner, touching] : at_corner) {
    if (touching.size() != 2) continue;
    std::size_t first = touching[0], second = touching[1];
    if (first == second) continue;
    if (edges[first].end != corner) std::swap(first, second);
    PlaneEdge& into = edges[first];
    const PlaneEdge& from = edges[second];
    if (into.end != corner || from.start != corner || into.right != from.right || into.left != from.left ||
        cross(into.start, into.end, from.end) != 0)
      continue;
    // A spike that turns back on itself is no straight run.
    const int64_t onward = int64_t{into.end.x - into.start.x} * (from.end.x - from.start.x) +
                           int64_t{into.end.y - into.start.y} * (from.end.y - from.start.y);
    if (onward <= 0) continue;
    into.end = from.end;
    gone[second] = true;
    for (std::size_t& index : at_corner[from.end])
      if (index == second) index = first;
  }
  std::vector<PlaneEdge> result;
  for (std::size_t i = 0; i < edges.size(); ++i)
    if (!gone[i]) result.push_back(edges[i]);
  return result;
}

}  // namespace comrad::doomgen
