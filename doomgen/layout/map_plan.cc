#include "doomgen/layout/map_plan.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <queue>
#include <tuple>

#include "doomgen/layout/map_validation.h"

namespace comrad::doomgen {
namespace {

constexpr int32_t kAnchorNumber = 9300, kFirstSpotNumber = 9301, kMapSpotNumber = 9001;
constexpr int32_t kStartLineSpecial = 1;  // Polyobj_StartLine(number, mirror, sound)
constexpr int32_t kControlMargin = 32, kControlGap = 64;
constexpr int32_t kPolyobjectHalfMin = 8;
constexpr int kPointTries = 4096;

std::string in_quotes(const std::string& name) { return "'" + name + "'"; }

bool on_segment(Point p, Point a, Point b) {
  return cross(a, b, p) == 0 && p.x >= std::min(a.x, b.x) && p.x <= std::max(a.x, b.x) &&
         p.y >= std::min(a.y, b.y) && p.y <= std::max(a.y, b.y);
}

/// Editor number of a player's start: 1..4, then ZDoom's 4001..4004.
int32_t start_number(int player) { return player <= 4 ? player : 4001 + player - 5; }

/// The rectangle that a straight piece of way takes, `width` across; pieces that bend overlap in the corner.
Box piece_of_way(Point a, Point b, int32_t width, bool grow_start, bool grow_end) {
  const int32_t low = width / 2, high = width - low;
  Box box = bounds_of(std::array{a, b});
  const bool east_west = a.y == b.y;
  const bool start_is_low = east_west ? a.x <= b.x : a.y <= b.y;
  const bool grow_low = start_is_low ? grow_start : grow_end,
             grow_high = start_is_low ? grow_end : grow_start;
  if (east_west) {
    box.low.y -= low, box.high.y += high;
    if (grow_low) box.low.x -= low;
    if (grow_high) box.high.x += high;
  } else {
    box.low.x -= low, box.high.x += high;
    if (grow_low) box.low.y -= low;
    if (grow_high) box.high.y += high;
  }
  return box;
}

/// A way's corners; its first and last points are kept.
std::vector<Point> corners_of(const std::vector<Point>& way) {
  std::vector<Point> corners;
  for (const Point& p : way) {
    if (corners.size() >= 2) {
      const Point a = corners[corners.size() - 2], b = corners.back();
      if ((a.x == b.x && b.x == p.x) || (a.y == b.y && b.y == p.y)) corners.pop_back();
    }
    corners.push_back(p);
  }
  return corners;
}

void lay_way(MapPlan& plan, AreaId area, const std::vector<Point>& way, int32_t width) {
  const std::vector<Point> corners = corners_of(way);
  for (std::size_t i = 0; i + 1 < corners.size(); ++i)
    plan.extend_area(area, piece_of_way(corners[i], corners[i + 1], width, i > 0, i + 2 < corners.size()),
                     Claim::kOnlyRock);
}

}  // namespace

// ---------------------------------------------------------------------------------------------------- areas

AreaId MapPlan::declare(AreaSpec spec) {
  const AreaId id = area_count();
  if (spec.name.empty()) spec.name = fmt::format("area {}", id);
  if (area(spec.name) != kRock) fail("there are two areas of the name " + in_quotes(spec.name));
  if (spec.ceiling < spec.floor)
    fail(fmt::format("area {}: its ceiling ({}) lies below its floor ({})", in_quotes(spec.name),
                     spec.ceiling, spec.floor));
  specs_.push_back(std::move(spec));
  edges_.reset();
  return id;
}

void MapPlan::add_shape(int owner, Polygon outline, Claim claim, const std::string& what) {
  if (outline.size() < 3 || twice_area(outline) == 0)
    return fail(what + ": an outline has no surface; give at least three corners that are not in line" +
                (outline.empty() ? "" : ", near " + at(outline[0])));
  for (const Point& p : outline)
    if (std::abs(p.x) > kMaxCoordinate || std::abs(p.y) > kMaxCoordinate)
      return fail(fmt::format("{}: the corner {} lies outside +-{}", what, at(p), kMaxCoordinate));
  shapes_.push_back({std::move(outline), owner, claim == Claim::kOnlyRock});
  edges_.reset();
}

AreaId MapPlan::add_area(AreaSpec spec, Polygon outline, Claim claim) {
  const AreaId area = declare(std::move(spec));
  extend_area(area, std::move(outline), claim);
  return area;
}

AreaId MapPlan::add_area(AreaSpec spec, const Box& box, Claim claim) {
  return add_area(std::move(spec), box.polygon(), claim);
}

void MapPlan::extend_area(AreaId area, Polygon outline, Claim claim) {
  if (area < 0 || area >= area_count())
    return fail(fmt::format("an outline names area {}, which is not there", area));
  add_shape(area, std::move(outline), claim, "area " + in_quotes(specs_[area].name));
}

void MapPlan::extend_area(AreaId area, const Box& box, Claim claim) {
  extend_area(area, box.polygon(), claim);
}

void MapPlan::add_pillar(Polygon outline, std::string wall_texture) {
  int owner = kRock;
  if (!wall_texture.empty()) {
    const auto found = std::find(rock_textures_.begin(), rock_textures_.end(), wall_texture);
    owner = -2 - static_cast<int>(found - rock_textures_.begin());
    if (found == rock_textures_.end()) rock_textures_.push_back(std::move(wall_texture));
  }
  add_shape(owner, std::move(outline), Claim::kAll, "a pillar");
}

void MapPlan::add_pillar(const Box& box, std::string wall_texture) {
  add_pillar(box.polygon(), std::move(wall_texture));
}

// ----------------------------------------------------------------------------------------------------- ways

std::vector<Point> MapPlan::find_way(AreaId from, AreaId to, const CorridorOptions& options,
                                     const std::string& name) {
  if (from < 0 || to < 0 || from >= area_count() || to >= area_count() || from == to) {
    fail(in_quotes(name) + ": a way leads from one area to another one");
    return {};
  }
  if (options.width < 1 || options.grid < 1) {
    fail(in_quotes(name) + ": width and grid must be positive");
    return {};
  }
  std::vector<Point> corners;
  for (const Shape& shape : shapes_)
    corners.insert(corners.end(), shape.outline.begin(), shape.outline.end());
  const Box bounds = bounds_of(corners).grown(2 * options.width);
  const int32_t grid = options.grid;
  const int32_t columns = (bounds.high.x - bounds.low.x) / grid + 1,
                rows = (bounds.high.y - bounds.low.y) / grid + 1;
  if (int64_t{columns} * rows > 4'000'000) {
    fail(fmt::format("{}: the map is too large for a way on a grid of {}; take a coarser one",
                     in_quotes(name), grid));
    return {};
  }
  const auto place = [&](int32_t index) {
    return Point{bounds.low.x + (index % columns) * grid, bounds.low.y + (index / columns) * grid};
  };
  // 0 free, 1 start, 2 goal, 3 other areas and all that is nearer to them than half a width.
  std::vector<uint8_t> kind(static_cast<std::size_t>(columns) * rows, 0);
  const int32_t half = (options.width + 1) / 2;
  for (int32_t i = 0; i < columns * rows; ++i) {
    const AreaId here = area_at(place(i));
    kind[i] = here == from ? 1 : here == to ? 2 : here >= 0 ? 3 : 0;
  }
  for (const PlaneEdge& edge : edges()) {
    for (const AreaId owner : {edge.right, edge.left}) {
      if (owner < 0 || owner == from || owner == to) continue;
      const Box near = bounds_of(std::array{edge.start, edge.end}).grown(half - 1);
      const int32_t low_x = std::max(0, (near.low.x - bounds.low.x + grid - 1) / grid),
                    high_x = std::min(columns - 1, (near.high.x - bounds.low.x) / grid),
                    low_y = std::max(0, (near.low.y - bounds.low.y + grid - 1) / grid),
                    high_y = std::min(rows - 1, (near.high.y - bounds.low.y) / grid);
      for (int32_t row = low_y; row <= high_y; ++row)
        for (int32_t column = low_x; column <= high_x; ++column)
          if (uint8_t& state = kind[static_cast<std::size_t>(row) * columns + column];
              state == 0 && nearer_than(place(row * columns + column), edge.start, edge.end, half))
            state = 3;
    }
  }
  const Box goal = this->bounds(to);
  // A* over (place, heading): a turn costs as much as four steps, so that ways are straight where they can
  // be. Steps inside the two areas are free of charge only in the order of their length, like all others.
  constexpr int kHeadings = 5;  // none yet, east, north, west, south
  const auto far_off = [&](Point p) {
    return (std::max({goal.low.x - p.x, p.x - goal.high.x, 0}) +
            std::max({goal.low.y - p.y, p.y - goal.high.y, 0})) /
           grid;
  };
  using Entry = std::tuple<int32_t, int32_t, int32_t>;  // estimate, cost, state
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  std::vector<int32_t> cost(static_cast<std::size_t>(columns) * rows * kHeadings, INT32_MAX);
  std::vector<int32_t> before(cost.size(), -1);
  const Point middle_from = centroid(from), middle_to = centroid(to);
  // Beginning off the middle costs a little, so that doors come to lie in the middle of walls.
  const auto off_middle = [&](Point p, Point middle) {
    return std::min(std::abs(p.x - middle.x), std::abs(p.y - middle.y)) / grid;
  };
  for (int32_t i = 0; i < columns * rows; ++i)
    if (kind[i] == 1) {
      cost[static_cast<std::size_t>(i) * kHeadings] = off_middle(place(i), middle_from);
      open.push({far_off(place(i)) + off_middle(place(i), middle_from), off_middle(place(i), middle_from),
                 i * kHeadings});
    }
  constexpr int32_t kNarrowCost = 64;
  const auto opens_wide = [&](Point p, int way_heading, AreaId into) {
    const bool east_west = way_heading == 1 || way_heading == 3;
    const int32_t reach = half - 1;
    return area_at(east_west ? Point{p.x, p.y - reach} : Point{p.x - reach, p.y}) == into &&
           area_at(east_west ? Point{p.x, p.y + reach} : Point{p.x + reach, p.y}) == into;
  };
  constexpr int32_t kStepX[] = {0, 1, 0, -1, 0}, kStepY[] = {0, 0, 1, 0, -1};
  while (!open.empty()) {
    const auto [estimate, so_far, state] = open.top();
    open.pop();
    if (so_far != cost[state]) continue;
    const int32_t index = state / kHeadings, heading = state % kHeadings;
    if (kind[index] == 2) {
      std::vector<Point> way;
      for (int32_t s = state; s >= 0; s = before[s]) way.push_back(place(s / kHeadings));
      std::reverse(way.begin(), way.end());
      // One place inside either area suffices.
      while (way.size() > 2 && area_at(way[1]) == from) way.erase(way.begin());
      return way;
    }
    for (int next_heading = 1; next_heading < kHeadings; ++next_heading) {
      const int32_t column = index % columns + kStepX[next_heading],
                    row = index / columns + kStepY[next_heading];
      if (column < 0 || row < 0 || column >= columns || row >= rows) continue;
      const int32_t next = row * columns + column;
      if (kind[next] == 3 || (kind[next] == 1 && kind[index] != 1)) continue;
      int32_t next_cost = so_far + 1 + (heading != 0 && heading != next_heading ? 4 : 0);
      // The way's whole width should open into both areas, and near the middle of their walls.
      if (kind[index] == 1 && kind[next] != 1 && !opens_wide(place(index), next_heading, from))
        next_cost += kNarrowCost;
      if (kind[next] == 2) {
        next_cost += off_middle(place(next), middle_to);
        if (!opens_wide(place(next), next_heading, to)) next_cost += kNarrowCost;
      }
      const int32_t next_state = next * kHeadings + next_heading;
      if (next_cost >= cost[next_state]) continue;
      cost[next_state] = next_cost;
      before[next_state] = state;
      open.push({next_cost + far_off(place(next)), next_cost, next_state});
    }
  }
  fail(fmt::format("{}: there is no way of width {} through rock from area {} to area {}", in_quotes(name),
                   options.width, in_quotes(specs_[from].name), in_quotes(specs_[to].name)));
  return {};
}

AreaId MapPlan::add_corridor(AreaSpec spec, AreaId from, AreaId to, const CorridorOptions& options) {
  const std::vector<Point> way = find_way(from, to, options, spec.name);
  const AreaId area = declare(std::move(spec));
  if (!way.empty()) lay_way(*this, area, way, options.width);
  return area;
}

std::vector<AreaId> MapPlan::add_stairs(const AreaSpec& spec, AreaId from, AreaId to, int count,
                                        const CorridorOptions& options) {
  std::vector<AreaId> steps;
  const std::vector<Point> way = find_way(from, to, options, spec.name);
  if (way.size() < 2) return steps;
  const auto piece_count = static_cast<int>(way.size()) - 1;
  count = std::clamp(count, 1, piece_count);
  const int32_t low = specs_[from].floor, high = specs_[to].floor;
  const int32_t ceiling = std::max(specs_[from].ceiling, specs_[to].ceiling);
  for (int j = 0; j < count; ++j) {
    AreaSpec step = spec;
    step.name += fmt::format(" {}", j);
    step.floor = low + (high - low) * (j + 1) / (count + 1);
    step.ceiling = ceiling;
    const AreaId area = declare(std::move(step));
    const auto first = way.begin() + piece_count * j / count,
               last = way.begin() + piece_count * (j + 1) / count;
    lay_way(*this, area, {first, last + 1}, options.width);
    steps.push_back(area);
  }
  return steps;
}

std::vector<AreaId> MapPlan::add_stairs(const AreaSpec& spec, const Box& box, Direction up, int count,
                                        int32_t low, int32_t high) {
  std::vector<AreaId> steps;
  if (count < 1) fail(in_quotes(spec.name) + ": a flight has at least one step");
  for (int j = 0; j < count; ++j) {
    AreaSpec step = spec;
    step.name += fmt::format(" {}", j);
    step.floor = count == 1 ? high : low + (high - low) * j / (count - 1);
    const bool east_west = up == Direction::kEast || up == Direction::kWest;
    const int place = up == Direction::kEast || up == Direction::kNorth ? j : count - 1 - j;
    const auto along = [&](int32_t from, int32_t to, int index) {
      return from + (to - from) * index / count;
    };
    Box piece = box;
    if (east_west)
      piece.low.x = along(box.low.x, box.high.x, place),
      piece.high.x = along(box.low.x, box.high.x, place + 1);
    else
      piece.low.y = along(box.low.y, box.high.y, place),
      piece.high.y = along(box.low.y, box.high.y, place + 1);
    steps.push_back(add_area(std::move(step), piece));
  }
  return steps;
}

AreaId MapPlan::add_slab(AreaSpec spec, AreaId area, AreaId beyond, int32_t thickness) {
  std::vector<Polygon> slabs;
  if (area >= 0 && area < area_count())
    for (const PlaneEdge& edge : boundary(area)) {
      if (edge.left != beyond || beyond < 0) continue;
      // Inwards is to the right of the edge.
      const Point a = edge.start, b = edge.end;
      if (a.x == b.x) {
        const int32_t inwards = b.y > a.y ? thickness : -thickness;
        slabs.push_back({a, b, {b.x + inwards, b.y}, {a.x + inwards, a.y}});
      } else if (a.y == b.y) {
        const int32_t inwards = b.x > a.x ? -thickness : thickness;
        slabs.push_back({a, b, {b.x, b.y + inwards}, {a.x, a.y + inwards}});
      } else {
        fail("area " + in_quotes(spec.name) + ": the edge " + at(a) + "-" + at(b) +
             " is oblique; give the door's place as an outline");
      }
    }
  if (slabs.empty())
    fail("area " + in_quotes(spec.name) + ": the areas " +
         (area >= 0 && area < area_count() ? in_quotes(specs_[area].name) : "?") + " and " +
         (beyond >= 0 && beyond < area_count() ? in_quotes(specs_[beyond].name) : "?") +
         " have no common edge");
  const AreaId slab = declare(std::move(spec));
  for (Polygon& outline : slabs) extend_area(slab, std::move(outline));
  return slab;
}

AreaId MapPlan::add_door(AreaSpec spec, AreaId area, AreaId beyond, int32_t thickness) {
  if (area >= 0 && area < area_count()) spec.floor = specs_[area].floor, spec.light = specs_[area].light;
  spec.ceiling = spec.floor;
  return add_slab(std::move(spec), area, beyond, thickness);
}

AreaId MapPlan::add_door(AreaSpec spec, const Box& box) {
  spec.ceiling = spec.floor;
  return add_area(std::move(spec), box);
}

std::vector<AreaId> MapPlan::add_grid(const AreaSpec& spec, Point low, int columns, int rows, int32_t cell) {
  std::vector<AreaId> areas;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      AreaSpec one = spec;
      one.name += fmt::format(" {},{}", column, row);
      one.tag = spec.tag + row * columns + column;
      const Point corner{low.x + column * cell, low.y + row * cell};
      areas.push_back(add_area(std::move(one), Box{corner, {corner.x + cell, corner.y + cell}}));
    }
  return areas;
}

// ------------------------------------------------------------------------------------------ lines and things

void MapPlan::connect(AreaId first, AreaId second, Passage passage) {
  passages_[std::minmax(first, second)] = std::move(passage);
}

const Passage& MapPlan::passage(AreaId first, AreaId second) const {
  static const Passage open = Passage::open();
  const auto found = passages_.find(std::minmax(first, second));
  return found != passages_.end() ? found->second : open;
}

void MapPlan::set_line(Point a, Point b, LineSpec line) { lines_.push_back({a, b, std::move(line)}); }

void MapPlan::add_polyobject(PolyobjectSpec spec) {
  const std::string name = fmt::format("polyobject {}", spec.number);
  if (spec.outline.size() < 3 || twice_area(spec.outline) == 0)
    return fail(name + ": its outline has no surface");
  const Box box = bounds_of(spec.outline);
  if (box.high.x - box.low.x < 2 * kPolyobjectHalfMin || box.high.y - box.low.y < 2 * kPolyobjectHalfMin)
    return fail(fmt::format("{}: it must measure at least {} units each way", name, 2 * kPolyobjectHalfMin));
  if (spec.motions.size() > 4) return fail(name + ": a control area has four lines for motions");
  for (const PolyobjectSpec& other : polyobjects_)
    if (other.number == spec.number)
      return fail(fmt::format("there are two polyobjects of the number {}", spec.number));
  polyobjects_.push_back(std::move(spec));
}

void MapPlan::add_start(int player, Point position, int32_t angle_degrees) {
  if (player < 1 || player > 8) return fail(fmt::format("a start is for player 1..8, not for {}", player));
  add_thing({.position = position, .angle_degrees = angle_degrees, .editor_number = start_number(player)});
}

void MapPlan::add_spot(int32_t id, Point position, int32_t angle_degrees) {
  add_thing(
      {.position = position, .angle_degrees = angle_degrees, .editor_number = kMapSpotNumber, .id = id});
}

// ------------------------------------------------------------------------------------------------- questions

AreaId MapPlan::area(const std::string& name) const {
  for (AreaId id = 0; id < area_count(); ++id)
    if (specs_[id].name == name) return id;
  return kRock;
}

AreaId MapPlan::area_at(Point p) const {
  if (!field_) return std::max(kRock, owner_at(shapes_, p));
  const int cell = field_->cell_at(p);
  return cell < field_->inner_count ? std::max(kRock, owner_at(shapes_, field_->seeds[cell])) : kRock;
}

const std::vector<PlaneEdge>& MapPlan::edges() const {
  if (!edges_) edges_ = field_ ? organic_edges() : subdivide(shapes_);
  return *edges_;
}

std::vector<PlaneEdge> MapPlan::organic_edges() const {
  const std::vector<Point>& seeds = field_->seeds;
  std::vector<int> owner(seeds.size(), kRock);
  for (const Shape& shape : shapes_) {
    const Box box = bounds_of(shape.outline);
    bool caught = false;
    for (int i = 0; i < field_->inner_count; ++i) {
      const Point p = seeds[i];
      if (p.x < box.low.x || p.x > box.high.x || p.y < box.low.y || p.y > box.high.y ||
          !inside(shape.outline, p))
        continue;
      caught = true;
      if (!shape.only_rock || owner[i] < 0) owner[i] = shape.owner;
    }
    if (caught || shape.only_rock) continue;
    // Too small for any seed: the nearest one, if it is not far off.
    const Point middle{box.low.x + (box.high.x - box.low.x) / 2, box.low.y + (box.high.y - box.low.y) / 2};
    const int64_t reach = 2 * std::max(box.high.x - box.low.x, box.high.y - box.low.y);
    int64_t best = reach * reach + 1;
    int nearest = -1;
    for (int i = 0; i < field_->inner_count; ++i)
      if (const int64_t distance = distance_squared(seeds[i], middle); distance < best)
        best = distance, nearest = i;
    if (nearest >= 0) owner[nearest] = shape.owner;
  }
  std::vector<PlaneEdge> edges;
  for (const CellRidge& ridge : field_->ridges) {
    const int right = owner[ridge.right], left = owner[ridge.left];
    if (right == left || (right < 0 && left < 0)) continue;
    if (left >= 0 && (right < 0 || left < right))
      edges.push_back({ridge.end, ridge.start, left, right});
    else
      edges.push_back({ridge.start, ridge.end, right, left});
  }
  return join_straight(std::move(edges));
}

std::vector<PlaneEdge> MapPlan::boundary(AreaId area) const {
  std::vector<PlaneEdge> result;
  for (const PlaneEdge& edge : edges()) {
    if (edge.right == area) result.push_back(edge);
    if (edge.left == area) result.push_back({edge.end, edge.start, edge.left, edge.right});
  }
  return result;
}

Box MapPlan::bounds(AreaId area) const {
  std::vector<Point> corners;
  for (const PlaneEdge& edge : boundary(area)) corners.push_back(edge.start), corners.push_back(edge.end);
  return corners.empty() ? Box{} : bounds_of(corners);
}

Point MapPlan::centroid(AreaId area) const {
  __int128 sum_x = 0, sum_y = 0, surface = 0;
  for (const PlaneEdge& edge : boundary(area)) {
    const Point a = edge.start, b = edge.end;
    const __int128 piece = __int128{a.x} * b.y - __int128{b.x} * a.y;
    surface += piece;
    sum_x += (a.x + b.x) * piece;
    sum_y += (a.y + b.y) * piece;
  }
  if (surface == 0) return {};
  return {static_cast<int32_t>(sum_x / (3 * surface)), static_cast<int32_t>(sum_y / (3 * surface))};
}

bool MapPlan::is_clear(AreaId area, Point p, int32_t clearance) const {
  if (area_at(p) != area) return false;
  for (const PlaneEdge& edge : edges())
    if ((edge.right == area || edge.left == area) && nearer_than(p, edge.start, edge.end, clearance))
      return false;
  return true;
}

std::optional<Point> MapPlan::random_point(AreaId area, int32_t clearance, Rng& rng) const {
  const std::vector<PlaneEdge> border = boundary(area);
  if (border.empty()) return std::nullopt;
  const Box box = bounds(area);
  for (int i = 0; i < kPointTries; ++i) {
    const int32_t x = rng.between(box.low.x, box.high.x);
    const Point p{x, rng.between(box.low.y, box.high.y)};
    const bool clear = std::none_of(border.begin(), border.end(), [&](const PlaneEdge& edge) {
      return nearer_than(p, edge.start, edge.end, clearance);
    });
    if (clear && area_at(p) == area) return p;
  }
  return std::nullopt;
}

std::vector<Point> MapPlan::random_points(AreaId area, int count, const PointOptions& options,
                                          Rng& rng) const {
  std::vector<Point> points;
  const auto draw = [&](int tries, int64_t distance) {
    for (int i = 0; i < tries && static_cast<int>(points.size()) < count; ++i) {
      const auto p = random_point(area, options.clearance, rng);
      if (!p) return;
      const bool apart = std::all_of(points.begin(), points.end(), [&](Point other) {
        return distance_squared(*p, other) >= distance * distance;
      });
      if (apart) points.push_back(*p);
    }
  };
  draw(20 * count, std::max(1, options.spacing));
  draw(20 * count, 1);
  return points;
}

// --------------------------------------------------------------------------------------------------- the end

void MapPlan::use_organic_outlines(const Box& bounds, int cell_count, RngKey key) {
  field_ = make_cell_field(bounds, cell_count, key);
  edges_.reset();
}

void MapPlan::fail(std::string message) {
  if (mistake_.empty()) mistake_ = std::move(message);
}

/// Control areas lie in a row north of the map, one for each polyobject.
void MapPlan::place_polyobjects(MapPlan& plan) const {
  std::vector<Point> corners;
  for (const Shape& shape : shapes_)
    corners.insert(corners.end(), shape.outline.begin(), shape.outline.end());
  if (corners.empty()) return;
  const Box map = bounds_of(corners);
  Point place{map.low.x, map.high.y + kControlGap};
  int32_t row_height = 0;
  for (const PolyobjectSpec& spec : polyobjects_) {
    const Box body = bounds_of(spec.outline);
    const int32_t width = body.high.x - body.low.x + 2 * kControlMargin,
                  height = body.high.y - body.low.y + 2 * kControlMargin;
    if (place.x + width > map.high.x && place.x > map.low.x)
      place = {map.low.x, place.y + row_height + kControlGap}, row_height = 0;
    row_height = std::max(row_height, height);
    const Box room{place, {place.x + width, place.y + height}};
    const Point anchor{place.x + kControlMargin - body.low.x, place.y + kControlMargin - body.low.y};
    const std::string name = fmt::format("polyobject {}", spec.number);
    plan.add_area(
        {.name = name, .floor = spec.floor, .ceiling = spec.ceiling, .wall_texture = spec.wall_texture},
        room);
    Polygon outline;
    for (const Point& p : spec.outline) outline.push_back({p.x + anchor.x, p.y + anchor.y});
    plan.set_line(outline[0], outline[1],
                  {.special = kStartLineSpecial,
                   .args = {spec.number, spec.mirror, spec.sound, 0, 0},
                   .blocking = true});
    plan.add_pillar(outline, spec.wall_texture);
    const Polygon walls = room.polygon();
    for (std::size_t i = 0; i < spec.motions.size(); ++i)
      plan.set_line(walls[i], walls[(i + 1) % walls.size()], spec.motions[i]);
    plan.add_thing({.position = anchor, .angle_degrees = spec.number, .editor_number = kAnchorNumber});
    plan.add_thing({.position = spec.spot,
                    .angle_degrees = spec.number,
                    .editor_number = kFirstSpotNumber + static_cast<int32_t>(spec.touch)});
    place.x += width + kControlGap;
  }
}

Expected<MapData> MapPlan::build() const {
  if (!mistake_.empty()) return Error{ErrorCode::kBadInput, "map: " + mistake_};
  if (polyobjects_.empty()) return build_plain();
  if (field_)
    return Error{ErrorCode::kUnsupported,
                 "map: polyobjects need exact outlines; leave use_organic_outlines() out"};
  MapPlan whole = *this;
  whole.polyobjects_.clear();
  place_polyobjects(whole);
  if (!whole.mistake_.empty()) return Error{ErrorCode::kBadInput, "map: " + whole.mistake_};
  return whole.build_plain();
}

/// An area in one piece has one outer outline. Outlines are followed with the area to the right, at corners
/// where several meet by the sharpest turn to the right, so that pieces that touch in a corner stay apart.
Status MapPlan::check_pieces(const std::vector<PlaneEdge>& all) const {
  for (AreaId area = 0; area < area_count(); ++area) {
    std::vector<std::pair<Point, Point>> edges;
    for (const PlaneEdge& edge : all) {
      if (edge.right == area) edges.push_back({edge.start, edge.end});
      if (edge.left == area) edges.push_back({edge.end, edge.start});
    }
    const std::string name = "map: area " + in_quotes(specs_[area].name);
    if (edges.empty())
      return Error{ErrorCode::kBadInput,
                   name + " has no place: later areas cover all of it, or no outline was given"};
    if (specs_[area].in_pieces) continue;
    std::sort(edges.begin(), edges.end());
    std::vector<bool> used(edges.size());
    int outer = 0;
    Point second_piece{};
    for (std::size_t first = 0; first < edges.size(); ++first) {
      if (used[first]) continue;
      int64_t surface = 0;
      for (std::size_t current = first; !used[current];) {
        used[current] = true;
        const Point a = edges[current].first, b = edges[current].second;
        surface += int64_t{a.x} * b.y - int64_t{b.x} * a.y;
        // The next edge leaves b; of several the one that turns most to the right.
        const auto range = std::equal_range(edges.begin(), edges.end(), std::pair(b, Point{}),
                                            [](const auto& x, const auto& y) { return x.first < y.first; });
        std::size_t best = edges.size();
        const auto turns_more = [&](std::size_t candidate, std::size_t than) {
          const auto half = [&](Point p) {  // right half first: 0 right, 1 straight on, 2 left, 3 back
            const int64_t side = cross(a, b, p);
            if (side != 0) return side < 0 ? 0 : 2;
            return int64_t{b.x - a.x} * (p.x - b.x) + int64_t{b.y - a.y} * (p.y - b.y) > 0 ? 1 : 3;
          };
          const Point p = edges[candidate].second, q = edges[than].second;
          if (half(p) != half(q)) return half(p) < half(q);
          return cross(b, p, q) > 0;
        };
        for (auto it = range.first; it != range.second; ++it) {
          const std::size_t candidate = it - edges.begin();
          if (used[candidate] && candidate != first) continue;
          if (best == edges.size() || turns_more(candidate, best)) best = candidate;
        }
        if (best == edges.size()) break;  // validate_map() reports what is not closed
        current = best;
      }
      if (surface < 0 && ++outer == 2) second_piece = edges[first].first;
    }
    if (outer > 1)
      return Error{ErrorCode::kBadInput,
                   fmt::format("{} is in {} pieces, one of them at {}; set in_pieces where that is meant",
                               name, outer, at(second_piece))};
  }
  return {};
}

Expected<MapData> MapPlan::build_plain() const {
  const std::vector<PlaneEdge>& plane = edges();
  COMRAD_TRY(check_pieces(plane));
  MapData map;
  map.things = things_;
  for (const AreaSpec& spec : specs_)
    map.sectors.push_back({spec.floor, spec.ceiling, spec.floor_texture, spec.ceiling_texture, spec.light,
                           spec.special, spec.tag, spec.name, spec.extra});

  std::map<Point, uint32_t> vertex_of;
  const auto vertex = [&](Point p) {
    const auto [found, is_new] = vertex_of.try_emplace(p, static_cast<uint32_t>(map.vertices.size()));
    if (is_new) map.vertices.push_back(p);
    return found->second;
  };
  std::vector<bool> line_found(lines_.size());
  /// The line's own specification, then the passage's, then those of the areas.
  const auto finish = [&](LinedefData line, const LineSpec& passage_line, AreaId right, AreaId left) {
    const Point a = map.vertices[line.start], b = map.vertices[line.end];
    static_cast<LineSpec&>(line) = passage_line;
    const auto take = [&](const LineSpec& from) {
      if (line.special == 0) line.special = from.special, line.args = from.args;
      if (line.id == 0) line.id = from.id;
      line.blocking |= from.blocking, line.block_monsters |= from.block_monsters;
      line.block_everything |= from.block_everything;
      line.upper_unpegged |= from.upper_unpegged, line.lower_unpegged |= from.lower_unpegged;
      line.secret |= from.secret, line.block_sound |= from.block_sound;
      line.hidden |= from.hidden, line.mapped |= from.mapped, line.repeatable |= from.repeatable;
      line.player_use |= from.player_use, line.player_cross |= from.player_cross;
      line.player_push |= from.player_push, line.impact |= from.impact;
      line.extra.insert(line.extra.end(), from.extra.begin(), from.extra.end());
    };
    for (std::size_t i = 0; i < lines_.size(); ++i)
      if (on_segment(a, lines_[i].a, lines_[i].b) && on_segment(b, lines_[i].a, lines_[i].b)) {
        take(lines_[i].line);
        line_found[i] = true;
      }
    take(specs_[right].lines);
    if (left >= 0) take(specs_[left].lines);
    if (!line.back) line.blocking = true;
    map.linedefs.push_back(std::move(line));
  };
  const auto wall = [&](Point start, Point end, AreaId area, int rock) {
    LinedefData line;
    line.start = vertex(start), line.end = vertex(end);
    line.front = static_cast<uint32_t>(map.sidedefs.size());
    const std::string& texture = rock <= -2 ? rock_textures_[-2 - rock] : specs_[area].wall_texture;
    map.sidedefs.push_back({static_cast<uint32_t>(area), "", texture, ""});
    finish(std::move(line), {}, area, kRock);
  };
  const auto upper = [&](AreaId area) -> const std::string& {
    return specs_[area].upper_texture.empty() ? specs_[area].wall_texture : specs_[area].upper_texture;
  };
  const auto lower = [&](AreaId area) -> const std::string& {
    return specs_[area].lower_texture.empty() ? specs_[area].wall_texture : specs_[area].lower_texture;
  };
  for (const PlaneEdge& edge : plane) {
    if (edge.left < 0) {
      wall(edge.start, edge.end, edge.right, edge.left);
      continue;
    }
    const Passage& between = passage(edge.right, edge.left);
    if (between.kind == Passage::Kind::kSolid) {
      wall(edge.start, edge.end, edge.right, kRock);
      wall(edge.end, edge.start, edge.left, kRock);
      continue;
    }
    LinedefData line;
    line.start = vertex(edge.start), line.end = vertex(edge.end);
    line.front = static_cast<uint32_t>(map.sidedefs.size());
    line.back = line.front + 1;
    // Floors may move later, so both steps have a texture on both sides. The lower one is that of the area
    // whose step it is; the upper one that of the area whose ceiling hangs lower.
    const auto right = static_cast<uint32_t>(edge.right), left = static_cast<uint32_t>(edge.left);
    map.sidedefs.push_back({right, upper(edge.left), between.middle_texture, lower(edge.left)});
    map.sidedefs.push_back({left, upper(edge.right), between.middle_texture, lower(edge.right)});
    finish(std::move(line), between.line, edge.right, edge.left);
  }
  for (std::size_t i = 0; i < lines_.size(); ++i)
    if (!line_found[i])
      return Error{ErrorCode::kBadInput, "map: no line lies on " + at(lines_[i].a) + "-" + at(lines_[i].b)};
  COMRAD_TRY(validate_map(map));
  return map;
}

}  // namespace comrad::doomgen
