#include "doomgen/layout/organic.h"

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <utility>

#include "rollout_buffer/core/check.h"

namespace comrad::doomgen {
namespace {

constexpr int32_t kFar = 1 << 18;  // corners of the first triangle, well outside of every map

/// Positive where `p` lies inside the circle through the counter-clockwise triangle a, b, c.
bool in_circle(Point a, Point b, Point c, Point p) {
  const int64_t ax = a.x - p.x, ay = a.y - p.y, bx = b.x - p.x, by = b.y - p.y, cx = c.x - p.x,
                cy = c.y - p.y;
  const __int128 a2 = ax * ax + ay * ay, b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
  return a2 * (bx * cy - by * cx) - b2 * (ax * cy - ay * cx) + c2 * (ax * by - ay * bx) > 0;
}

int64_t rounded(__int128 numerator, __int128 denominator) {
  if (denominator < 0) numerator = -numerator, denominator = -denominator;
  const __int128 doubled = 2 * numerator + denominator, divisor = 2 * denominator;
  __int128 quotient = doubled / divisor;
  if (doubled % divisor != 0 && doubled < 0) --quotient;
  return static_cast<int64_t>(quotient);
}

/// Centre of the circle through a, b, c, rounded to whole units.
Point circle_centre(Point a, Point b, Point c) {
  const int64_t bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
  const __int128 b2 = bx * bx + by * by, c2 = cx * cx + cy * cy,
                 twice = 2 * (__int128{bx} * cy - __int128{by} * cx);
  const int64_t x = a.x + rounded(cy * b2 - by * c2, twice), y = a.y + rounded(bx * c2 - cx * b2, twice);
  constexpr int64_t kLimit = 4 * kFar;  // nearly straight triangles at the rim
  return {static_cast<int32_t>(std::clamp(x, -kLimit, kLimit)),
          static_cast<int32_t>(std::clamp(y, -kLimit, kLimit))};
}

/// Adds points one by one: the triangles whose circle holds the new point go, and a fan round it fills
/// the hole.
class Triangulation {
 public:
  explicit Triangulation(const std::vector<Point>& points) : points_(points) {
    const int count = static_cast<int>(points.size());
    points_.insert(points_.end(), {{-kFar, -kFar}, {kFar, -kFar}, {0, kFar}});
    triangles_.push_back({{count, count + 1, count + 2}, {-1, -1, -1}});
    state_.push_back(0);
  }

  void add(int index) {
    const Point p = points_[index];
    ++round_;
    hole_.clear();
    rim_.clear();
    hole_.push_back(find(p));
    state_[hole_[0]] = round_;
    for (std::size_t i = 0; i < hole_.size(); ++i) {
      const int triangle = hole_[i];
      for (int side = 0; side < 3; ++side) {
        const int next = triangles_[triangle].neighbour[side];
        if (next >= 0 && state_[next] == round_) continue;
        if (next >= 0 && holds(next, p)) {
          state_[next] = round_;
          hole_.push_back(next);
        } else {
          rim_.push_back({triangles_[triangle].corner[(side + 1) % 3],
                          triangles_[triangle].corner[(side + 2) % 3], next, triangle});
        }
      }
    }
    // A triangle taken later may have been noted as the rim's other side before.
    std::erase_if(rim_,
                  [&](const RimEdge& edge) { return edge.outside >= 0 && state_[edge.outside] == round_; });
    std::sort(rim_.begin(), rim_.end(), [](const RimEdge& a, const RimEdge& b) { return a.from < b.from; });
    std::size_t reused = 0;
    fan_.clear();
    for (const RimEdge& edge : rim_) {
      int place = 0;
      if (reused < hole_.size()) {
        place = hole_[reused++];
      } else {
        place = static_cast<int>(triangles_.size());
        triangles_.emplace_back();
        state_.push_back(0);
      }
      triangles_[place] = {{index, edge.from, edge.to}, {edge.outside, -1, -1}};
      state_[place] = 0;
      fan_.push_back(place);
      if (edge.outside >= 0)
        for (int side = 0; side < 3; ++side) {
          const Triangle& other = triangles_[edge.outside];
          if (other.corner[(side + 1) % 3] == edge.to && other.corner[(side + 2) % 3] == edge.from)
            triangles_[edge.outside].neighbour[side] = place;
        }
    }
    for (std::size_t i = 0; i < fan_.size(); ++i) {
      // The neighbour across (to, p) is the fan's triangle that begins at `to`.
      const int to = triangles_[fan_[i]].corner[2];
      const auto next = std::lower_bound(rim_.begin(), rim_.end(), to,
                                         [](const RimEdge& edge, int corner) { return edge.from < corner; });
      COMRAD_CHECK(next != rim_.end() && next->from == to, "the rim of the hole is closed");
      const int neighbour = fan_[next - rim_.begin()];
      triangles_[fan_[i]].neighbour[1] = neighbour;
      triangles_[neighbour].neighbour[2] = fan_[i];
    }
    last_ = fan_[0];
  }

  /// Triangles of given points alone, neighbours renumbered.
  std::vector<Triangle> finish() && {
    const int count = static_cast<int>(points_.size()) - 3;
    std::vector<int> renamed(triangles_.size(), -1);
    std::vector<Triangle> result;
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      const Triangle& t = triangles_[i];
      if (t.corner[0] >= count || t.corner[1] >= count || t.corner[2] >= count) continue;
      renamed[i] = static_cast<int>(result.size());
      result.push_back(t);
    }
    for (Triangle& t : result)
      for (int& neighbour : t.neighbour) neighbour = neighbour >= 0 ? renamed[neighbour] : -1;
    return result;
  }

 private:
  struct RimEdge {
    int from, to, outside, inside;
  };
  bool holds(int triangle, Point p) const {
    const Triangle& t = triangles_[triangle];
    return in_circle(points_[t.corner[0]], points_[t.corner[1]], points_[t.corner[2]], p);
  }
  /// The triangle that contains `p`, walking from the last one.
  int find(Point p) const {
    int triangle = last_;
    for (std::size_t steps = 0; steps <= 4 * triangles_.size(); ++steps) {
      const Triangle& t = triangles_[triangle];
      int next = -1;
      for (int side = 0; side < 3 && next < 0; ++side)
        if (cross(points_[t.corner[(side + 1) % 3]], points_[t.corner[(side + 2) % 3]], p) < 0)
          next = t.neighbour[side];
      if (next < 0) return triangle;
      triangle = next;
    }
    COMRAD_CHECK(false, "a walk over a Delaunay triangulation ends");
    return 0;
  }

  std::vector<Point> points_;
  std::vector<Triangle> triangles_;
  std::vector<uint32_t> state_;
  std::vector<int> hole_, fan_;
  std::vector<RimEdge> rim_;
  uint32_t round_ = 0;
  int last_ = 0;
};

/// Points in rows of blocks, every other row backwards, so that each lies near the one before.
std::vector<int> local_order(const std::vector<Point>& points) {
  const Box bounds = bounds_of(points);
  const int32_t block = std::max<int32_t>(1, (bounds.high.x - bounds.low.x) / 48);
  std::vector<int> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  const auto key = [&](int index) {
    const int32_t row = (points[index].y - bounds.low.y) / block;
    const int32_t column = points[index].x - bounds.low.x;
    return std::pair(row, row % 2 == 0 ? column : -column);
  };
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::pair(key(a), a) < std::pair(key(b), b); });
  return order;
}

void remove_duplicates(std::vector<Point>& points, const Box& bounds, Rng& rng) {
  for (;;) {
    std::vector<Point> sorted = points;
    std::sort(sorted.begin(), sorted.end());
    if (std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end()) return;
    std::vector<Point> seen;
    for (Point& p : points) {
      const auto place = std::lower_bound(seen.begin(), seen.end(), p);
      if (place != seen.end() && *place == p)
        p = {rng.between(bounds.low.x, bounds.high.x), rng.between(bounds.low.y, bounds.high.y)};
      else
        seen.insert(place, p);
    }
  }
}

/// Points on a frame round the bounds, so that every inner cell is finite.
std::vector<Point> frame_points(const Box& bounds, int32_t spacing) {
  const Box frame = bounds.grown(spacing * 3 / 2);
  std::vector<Point> points;
  for (int32_t x = frame.low.x; x < frame.high.x; x += spacing) {
    points.push_back({x, frame.low.y});
    points.push_back({frame.high.x - (x - frame.low.x), frame.high.y});
  }
  for (int32_t y = frame.low.y; y < frame.high.y; y += spacing) {
    points.push_back({frame.high.x, y});
    points.push_back({frame.low.x, frame.high.y - (y - frame.low.y)});
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

int64_t square_root(int64_t value) {
  int64_t root = 0;
  for (int64_t bit = int64_t{1} << 31; bit > 0; bit >>= 1)
    if ((root + bit) * (root + bit) <= value) root += bit;
  return root;
}

}  // namespace

std::vector<Triangle> triangulate(const std::vector<Point>& points) {
  Triangulation triangulation(points);
  for (const int index : local_order(points)) triangulation.add(index);
  return std::move(triangulation).finish();
}

CellField make_cell_field(const Box& bounds, int cell_count, RngKey key, int lloyd_steps, int32_t weld) {
  COMRAD_CHECK(cell_count > 0 && bounds.low.x < bounds.high.x && bounds.low.y < bounds.high.y,
               "a field has room and cells");
  Rng rng(key.split("cells"));
  std::vector<Point> inner(static_cast<std::size_t>(cell_count));
  for (Point& p : inner)
    p = {rng.between(bounds.low.x, bounds.high.x), rng.between(bounds.low.y, bounds.high.y)};
  const int64_t area = int64_t{bounds.high.x - bounds.low.x} * (bounds.high.y - bounds.low.y);
  const auto spacing = static_cast<int32_t>(std::max<int64_t>(8, square_root(area / cell_count)));
  const std::vector<Point> frame = frame_points(bounds, spacing);

  CellField field;
  std::vector<Triangle> triangles;
  std::vector<Point> centres;
  for (int step = 0;; ++step) {
    remove_duplicates(inner, bounds, rng);
    field.seeds = inner;
    field.seeds.insert(field.seeds.end(), frame.begin(), frame.end());
    triangles = triangulate(field.seeds);
    centres.clear();
    for (const Triangle& t : triangles)
      centres.push_back(
          circle_centre(field.seeds[t.corner[0]], field.seeds[t.corner[1]], field.seeds[t.corner[2]]));
    if (step == lloyd_steps) break;
    std::vector<int64_t> sum_x(inner.size()), sum_y(inner.size()), count(inner.size());
    for (std::size_t i = 0; i < triangles.size(); ++i)
      for (const int corner : triangles[i].corner)
        if (corner < cell_count)
          sum_x[corner] += centres[i].x, sum_y[corner] += centres[i].y, ++count[corner];
    for (int i = 0; i < cell_count; ++i)
      if (count[i] > 0)
        inner[i] = {static_cast<int32_t>(
                        std::clamp<int64_t>(rounded(sum_x[i], count[i]), bounds.low.x, bounds.high.x)),
                    static_cast<int32_t>(
                        std::clamp<int64_t>(rounded(sum_y[i], count[i]), bounds.low.y, bounds.high.y))};
  }
  field.inner_count = cell_count;
  field.bucket_bounds = bounds_of(field.seeds);
  field.bucket_side = 2 * spacing;
  field.bucket_columns = (field.bucket_bounds.high.x - field.bucket_bounds.low.x) / field.bucket_side + 1;
  field.bucket_rows = (field.bucket_bounds.high.y - field.bucket_bounds.low.y) / field.bucket_side + 1;
  field.buckets.resize(static_cast<std::size_t>(field.bucket_columns) * field.bucket_rows);
  for (std::size_t i = 0; i < field.seeds.size(); ++i) {
    const int32_t column = (field.seeds[i].x - field.bucket_bounds.low.x) / field.bucket_side,
                  row = (field.seeds[i].y - field.bucket_bounds.low.y) / field.bucket_side;
    field.buckets[static_cast<std::size_t>(row) * field.bucket_columns + column].push_back(
        static_cast<int>(i));
  }

  // Corners that lie too close to each other become one: rounding could turn the ridge between them round.
  std::vector<int> parent(centres.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (const int neighbour : triangles[i].neighbour)
      if (neighbour >= 0 && distance_squared(centres[i], centres[neighbour]) < int64_t{weld} * weld) {
        const int a = root(static_cast<int>(i)), b = root(neighbour);
        parent[std::max(a, b)] = std::min(a, b);
      }
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const Triangle& t = triangles[i];
    for (int side = 0; side < 3; ++side) {
      const int neighbour = t.neighbour[side];
      if (neighbour < static_cast<int>(i)) continue;  // the rim, or done from the other side
      // The corners of the common edge are the two cells; the ridge runs from this circle's centre to the
      // other's. Edge from -> to is counter-clockwise, so the neighbour lies to its right, and crossing the
      // edge outwards the cell `from` lies to the right.
      const int from = t.corner[(side + 1) % 3], to = t.corner[(side + 2) % 3];
      const Point start = centres[root(static_cast<int>(i))], end = centres[root(neighbour)];
      if (start != end) field.ridges.push_back({start, end, from, to});
    }
  }
  return field;
}

int CellField::cell_at(Point p) const {
  const int32_t column = std::clamp((p.x - bucket_bounds.low.x) / bucket_side, 0, bucket_columns - 1),
                row = std::clamp((p.y - bucket_bounds.low.y) / bucket_side, 0, bucket_rows - 1);
  int best = 0;
  int64_t best_distance = INT64_MAX;
  // Squares in rings round the one of `p` (or the one nearest to it): the next ring lies at least `ring`
  // squares off, measured from a point inside.
  const Point inside_point{std::clamp(p.x, bucket_bounds.low.x, bucket_bounds.high.x),
                           std::clamp(p.y, bucket_bounds.low.y, bucket_bounds.high.y)};
  const int64_t slack = std::max(std::abs(p.x - inside_point.x), std::abs(p.y - inside_point.y));
  for (int32_t ring = 0; ring <= std::max(bucket_columns, bucket_rows); ++ring) {
    for (int32_t r = std::max(0, row - ring); r <= std::min(bucket_rows - 1, row + ring); ++r)
      for (int32_t c = std::max(0, column - ring); c <= std::min(bucket_columns - 1, column + ring); ++c) {
        if (std::max(std::abs(r - row), std::abs(c - column)) != ring) continue;
        for (const int seed : buckets[static_cast<std::size_t>(r) * bucket_columns + c]) {
          const int64_t distance = distance_squared(seeds[seed], p);
          if (distance < best_distance || (distance == best_distance && seed < best))
            best_distance = distance, best = seed;
        }
      }
    const int64_t reach = int64_t{ring} * bucket_side - slack;
    if (best_distance != INT64_MAX && reach > 0 && best_distance < reach * reach) break;
  }
  return best;
}

}  // namespace comrad::doomgen
