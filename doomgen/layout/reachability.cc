#include "doomgen/layout/reachability.h"

#include <algorithm>

namespace comrad::doomgen {
namespace {

enum : uint8_t { kFree, kBlocked, kReached };

int32_t floor_div(int32_t a, int32_t b) { return a / b - (a % b != 0 && (a < 0) != (b < 0)); }

}  // namespace

bool stops(const MapData& map, const LinedefData& line, const Body& body) {
  if (line.blocking || line.block_everything || !line.back) return true;
  const SectorData& front = map.sectors[map.sidedefs[line.front].sector];
  const SectorData& back = map.sectors[map.sidedefs[*line.back].sector];
  const int32_t bottom = std::max(front.floor_height, back.floor_height);
  const int32_t top = std::min(front.ceiling_height, back.ceiling_height);
  return top - bottom < body.height || std::abs(front.floor_height - back.floor_height) > body.step;
}

Reachability::Reachability(const MapData& map, std::span<const Point> starts, const Body& body)
    : radius_(body.radius) {
  bounds_ = bounds_of(map.vertices);
  columns_ = (bounds_.high.x - bounds_.low.x) / kGrid + 1;
  rows_ = (bounds_.high.y - bounds_.low.y) / kGrid + 1;
  state_.assign(static_cast<std::size_t>(columns_) * rows_, kFree);
  const auto place = [&](int32_t column, int32_t row) {
    return Point{bounds_.low.x + column * kGrid, bounds_.low.y + row * kGrid};
  };
  // A step of the grid is shorter than the body is wide, so that two free neighbours have no wall
  // between them.
  for (const LinedefData& line : map.linedefs) {
    if (!stops(map, line, body)) continue;
    const Point a = map.vertices[line.start], b = map.vertices[line.end];
    const Box near = bounds_of(std::array{a, b}).grown(body.radius);
    const int32_t first_column = std::max(0, floor_div(near.low.x - bounds_.low.x, kGrid));
    const int32_t last_column = std::min(columns_ - 1, floor_div(near.high.x - bounds_.low.x, kGrid) + 1);
    const int32_t first_row = std::max(0, floor_div(near.low.y - bounds_.low.y, kGrid));
    const int32_t last_row = std::min(rows_ - 1, floor_div(near.high.y - bounds_.low.y, kGrid) + 1);
    for (int32_t row = first_row; row <= last_row; ++row)
      for (int32_t column = first_column; column <= last_column; ++column) {
        const Point p = place(column, row);
        if (crosses_box(a, b, Box{p, p}.grown(body.radius)))
          state_[static_cast<std::size_t>(row) * columns_ + column] = kBlocked;
      }
  }
  std::vector<std::pair<int32_t, int32_t>> frontier;
  const auto visit = [&](int32_t column, int32_t row) {
    if (column < 0 || row < 0 || column >= columns_ || row >= rows_) return;
    uint8_t& state = state_[static_cast<std::size_t>(row) * columns_ + column];
    if (state != kFree) return;
    state = kReached;
    frontier.push_back({column, row});
  };
  for (const Point& start : starts) {
    const int32_t column = floor_div(start.x - bounds_.low.x, kGrid),
                  row = floor_div(start.y - bounds_.low.y, kGrid);
    for (int32_t i = 0; i < 4; ++i) visit(column + (i & 1), row + (i >> 1));
  }
  while (!frontier.empty()) {
    const auto [column, row] = frontier.back();
    frontier.pop_back();
    visit(column - 1, row);
    visit(column + 1, row);
    visit(column, row - 1);
    visit(column, row + 1);
  }
}

bool Reachability::reaches(Point p) const {
  const int32_t reach = radius_ / kGrid;
  const int32_t column = floor_div(p.x - bounds_.low.x, kGrid), row = floor_div(p.y - bounds_.low.y, kGrid);
  for (int32_t r = row - reach + 1; r <= row + reach; ++r)
    for (int32_t c = column - reach + 1; c <= column + reach; ++c)
      if (r >= 0 && c >= 0 && r < rows_ && c < columns_ &&
          state_[static_cast<std::size_t>(r) * columns_ + c] == kReached)
        return true;
  return false;
}

}  // namespace comrad::doomgen
