#include "sim_workers/oracle/navigator.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/map/level_index.h"

namespace comrad::sim {
namespace {

constexpr double kBodyRadius = 16, kBodyHeight = 56;
constexpr std::size_t kFieldCellsMax = 8'000'000;  // of all fields kept, 32 MB
constexpr float kNever = std::numeric_limits<float>::infinity();

double distance_to_segment(Place p, Place a, Place b) {
  const double dx = b.x - a.x, dy = b.y - a.y, squared = dx * dx + dy * dy;
  const double t = squared > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / squared, 0.0, 1.0) : 0.0;
  return std::hypot(p.x - a.x - t * dx, p.y - a.y - t * dy);
}

bool is_obstacle(const doom::Actor& actor) {
  return actor.has(doom::ActorFlag::kSolid) && actor.player_index < 0 &&
         !actor.has(doom::ActorFlag::kIsMonster) && !actor.removed;
}

/// Changes whenever something that decides about ways does.
uint64_t fingerprint_of(const doom::World& world) {
  uint64_t hash = mix64(world.sectors().size());
  for (const doom::Sector& sector : world.sectors())
    hash = mix64(hash ^ static_cast<uint32_t>(sector.floor_height) ^
                 (uint64_t{static_cast<uint32_t>(sector.ceiling_height)} << 32)) ^
           mix64(static_cast<uint64_t>(sector.special) * 31);
  for (const doom::LineState& line : world.lines()) hash = hash * 31 + line.flags;
  for (const doom::Actor& actor : world.actors())
    if (is_obstacle(actor))
      hash = mix64(hash ^ actor.id ^ (uint64_t{static_cast<uint32_t>(actor.x)} << 20) ^
                   static_cast<uint32_t>(actor.y));
  return hash;
}

}  // namespace

void Navigator::refresh(const doom::World& world) {
  const uint64_t fingerprint = fingerprint_of(world);
  const doom::Level& level = world.level();
  if (level_ == &level && fingerprint == fingerprint_) return;
  fields_.clear();
  fingerprint_ = fingerprint;
  if (level_ != &level) {
    level_ = &level;
    double right = -1e9, top = -1e9;
    left_ = bottom_ = 1e9;
    for (const doom::Vertex& vertex : level.vertices) {
      left_ = std::min(left_, doom::to_double(vertex.x)), right = std::max(right, doom::to_double(vertex.x));
      bottom_ = std::min(bottom_, doom::to_double(vertex.y)), top = std::max(top, doom::to_double(vertex.y));
    }
    columns_ = static_cast<int>((right - left_) / options_.cell_units) + 1;
    rows_ = static_cast<int>((top - bottom_) / options_.cell_units) + 1;
    sector_.assign(static_cast<std::size_t>(columns_) * rows_, -1);
    for (int cell = 0; cell < columns_ * rows_; ++cell) {
      const Place centre = centre_of(cell);
      const auto x = static_cast<doom::Fixed>(centre.x * 65536),
                 y = static_cast<doom::Fixed>(centre.y * 65536);
      if (world.index().outline.contains(x, y)) sector_[cell] = static_cast<int32_t>(world.sector_at(x, y));
    }
  }
  const std::size_t count = sector_.size();
  floor_.assign(count, 0), cost_.assign(count, 0), blocked_.assign(count, 0);
  for (std::size_t cell = 0; cell < count; ++cell) {
    if (sector_[cell] < 0) {
      blocked_[cell] = 1;
      continue;
    }
    const auto index = static_cast<uint32_t>(sector_[cell]);
    const doom::Sector& sector = world.sectors()[index];
    floor_[cell] = doom::to_float(sector.floor_height);
    if (doom::to_float(sector.ceiling_height) - floor_[cell] < kBodyHeight) blocked_[cell] = 1;
    if (options_.sector_cost) {
      cost_[cell] = static_cast<float>(options_.sector_cost(world, index));
      if (cost_[cell] < 0) blocked_[cell] = 1;
    }
  }
  // Whatever stops a body keeps its centre this far away.
  const double reach = kBodyRadius + options_.margin_units;
  const auto block_round = [&](Place a, Place b, double distance, auto&& is_kept_away) {
    const int first_column =
        static_cast<int>((std::min(a.x, b.x) - distance - left_) / options_.cell_units) - 1;
    const int last_column =
        static_cast<int>((std::max(a.x, b.x) + distance - left_) / options_.cell_units) + 1;
    const int first_row =
        static_cast<int>((std::min(a.y, b.y) - distance - bottom_) / options_.cell_units) - 1;
    const int last_row =
        static_cast<int>((std::max(a.y, b.y) + distance - bottom_) / options_.cell_units) + 1;
    for (int row = std::max(0, first_row); row <= std::min(rows_ - 1, last_row); ++row)
      for (int column = std::max(0, first_column); column <= std::min(columns_ - 1, last_column); ++column) {
        const int cell = row * columns_ + column;
        if (blocked_[cell] == 0 && distance_to_segment(centre_of(cell), a, b) < distance &&
            is_kept_away(cell))
          blocked_[cell] = 1;
      }
  };
  for (std::size_t i = 0; i < level.linedefs.size(); ++i) {
    const doom::Linedef& line = level.linedefs[i];
    if (line.in_polyobject) continue;
    const Place a{doom::to_double(level.vertices[line.start].x),
                  doom::to_double(level.vertices[line.start].y)};
    const Place b{doom::to_double(level.vertices[line.end].x), doom::to_double(level.vertices[line.end].y)};
    const uint32_t flags = world.lines()[i].flags;
    if (!line.back ||
        (flags & (doom::kLineBlocking | doom::kLineBlockEverything | doom::kLineBlockPlayers)) != 0) {
      block_round(a, b, reach, [](int) { return true; });
      continue;
    }
    const doom::Sector& front = world.sectors()[level.sidedefs[line.front].sector_index];
    const doom::Sector& back = world.sectors()[level.sidedefs[*line.back].sector_index];
    const double floor = doom::to_double(std::max(front.floor_height, back.floor_height));
    const double opening = doom::to_double(std::min(front.ceiling_height, back.ceiling_height)) - floor;
    if (opening < kBodyHeight) {
      block_round(a, b, reach, [](int) { return true; });
    } else {
      // A body stands on the highest floor that it touches: below a ledge it is on the ledge, or not there
      // at all.
      block_round(a, b, kBodyRadius, [&](int cell) {
        floor_[cell] = std::max(floor_[cell], static_cast<float>(floor));
        return false;
      });
    }
  }
  for (const doom::Actor& actor : world.actors())
    if (is_obstacle(actor)) {
      const Place centre = place_of(actor);
      block_round(centre, centre, (doom::to_double(actor.radius) + reach) * 1.2, [](int) { return true; });
    }
}

int Navigator::cell_of(Place place) const {
  const int column = std::clamp(static_cast<int>((place.x - left_) / options_.cell_units), 0, columns_ - 1);
  const int row = std::clamp(static_cast<int>((place.y - bottom_) / options_.cell_units), 0, rows_ - 1);
  return row * columns_ + column;
}

Place Navigator::centre_of(int cell) const {
  return {left_ + (cell % columns_ + 0.5) * options_.cell_units,
          bottom_ + (cell / columns_ + 0.5) * options_.cell_units};
}

bool Navigator::is_open(Place place) const { return columns_ > 0 && blocked_[cell_of(place)] == 0; }

bool Navigator::can_step(int from, int to) const {
  if (blocked_[to] != 0) return false;
  const float rise = floor_[to] - floor_[from];
  return rise <= options_.step_units && -rise <= options_.drop_units;
}

int Navigator::open_cell_near(Place place, double reach_units, Field* field) const {
  const auto is_good = [&](int cell) {
    return blocked_[cell] == 0 && (field == nullptr || settle(*field, cell));
  };
  const int cell = cell_of(place);
  if (is_good(cell)) return cell;
  const int reach = static_cast<int>(reach_units / options_.cell_units) + 1;
  const int column = cell % columns_, row = cell / columns_;
  int best = -1;
  double best_distance = reach_units;
  for (int r = std::max(0, row - reach); r <= std::min(rows_ - 1, row + reach); ++r)
    for (int c = std::max(0, column - reach); c <= std::min(columns_ - 1, column + reach); ++c) {
      const int other = r * columns_ + c;
      const double distance = distance_between(place, centre_of(other));
      if (distance < best_distance && is_good(other)) best = other, best_distance = distance;
    }
  return best;
}

std::optional<Place> Navigator::nearest_open(Place place, double reach_units) const {
  const int cell = open_cell_near(place, reach_units);
  if (cell < 0) return std::nullopt;
  return cell == cell_of(place) ? place : centre_of(cell);
}

Navigator::Field& Navigator::field_to(int goal_cell) {
  if (const auto found = fields_.find(goal_cell); found != fields_.end()) return found->second;
  if (fields_.size() * sector_.size() >= kFieldCellsMax) fields_.clear();
  Field& field = fields_[goal_cell];
  field.distance.assign(sector_.size(), kNever);
  field.distance[goal_cell] = 0;
  field.open.push({0.0f, goal_cell});
  return field;
}

bool Navigator::settle(Field& field, int wanted) const {
  const auto unit = static_cast<float>(options_.cell_units);
  while (!field.open.empty() && field.open.top().first < field.distance[wanted]) {
    const auto [distance, cell] = field.open.top();
    field.open.pop();
    if (distance > field.distance[cell]) continue;
    const int column = cell % columns_, row = cell / columns_;
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc) {
        if ((dr == 0 && dc == 0) || row + dr < 0 || row + dr >= rows_ || column + dc < 0 ||
            column + dc >= columns_)
          continue;
        const int other = cell + dr * columns_ + dc;
        if (blocked_[other] != 0 || !can_step(other, cell)) continue;
        if (dr != 0 && dc != 0 && (blocked_[cell + dc] != 0 || blocked_[cell + dr * columns_] != 0)) continue;
        const float next =
            distance + unit * (dr != 0 && dc != 0 ? 1.41421356f : 1.0f) * (1.0f + cost_[other]);
        if (next < field.distance[other]) {
          field.distance[other] = next;
          field.open.push({next, other});
        }
      }
  }
  return field.distance[wanted] != kNever;
}

std::optional<double> Navigator::way_length(Place from, Place goal) {
  const int end = open_cell_near(goal, 64);
  if (end < 0) return std::nullopt;
  Field& field = field_to(end);
  const int start = open_cell_near(from, 64, &field);
  if (start < 0) return std::nullopt;
  return field.distance[start];
}

bool Navigator::is_straight(Place from, Place to) const {
  const double distance = distance_between(from, to);
  const int steps = static_cast<int>(distance / (options_.cell_units * 0.5)) + 1;
  int last = cell_of(from);
  for (int i = 1; i <= steps; ++i) {
    const double t = static_cast<double>(i) / steps;
    const int cell = cell_of({from.x + (to.x - from.x) * t, from.y + (to.y - from.y) * t});
    if (cell == last) continue;
    if (!can_step(last, cell) || cost_[cell] > cost_[last]) return false;
    last = cell;
  }
  return true;
}

std::optional<Place> Navigator::waypoint(Place from, Place goal) {
  const int end = open_cell_near(goal, 64);
  if (end < 0) return std::nullopt;
  Field& field = field_to(end);
  const int start = open_cell_near(from, 64, &field);
  if (start < 0) return std::nullopt;
  const Place target = is_open(goal) ? goal : centre_of(end);
  if (is_straight(from, target)) return target;
  // Down the distances as far as the eye reaches.
  int cell = start;
  Place best = centre_of(start);
  for (int step = 0; step < 64 && cell != end; ++step) {
    int next = cell;
    const int column = cell % columns_, row = cell / columns_;
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc) {
        if (row + dr < 0 || row + dr >= rows_ || column + dc < 0 || column + dc >= columns_) continue;
        const int other = cell + dr * columns_ + dc;
        if (blocked_[other] != 0 || !can_step(cell, other)) continue;
        if (dr != 0 && dc != 0 && (blocked_[cell + dc] != 0 || blocked_[cell + dr * columns_] != 0)) continue;
        if (field.distance[other] < field.distance[next]) next = other;
      }
    if (next == cell) break;
    cell = next;
    if (step > 0 && !is_straight(from, centre_of(cell))) break;
    best = centre_of(cell);
  }
  return best;
}

}  // namespace comrad::sim
