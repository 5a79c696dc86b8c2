#include "sim_workers/engine/map/blockmap.h"

#include <utility>

namespace comrad::doom {
Box Box::around_ends(Fixed x1, Fixed y1, Fixed x2, Fixed y2) {
  return {std::min(x1, x2), std::max(x1, x2), std::min(y1, y2), std::max(y1, y2)};
}

Box Box::grown(Fixed margin) const {
  return {clamped_fixed(int64_t{left} - margin), clamped_fixed(int64_t{right} + margin),
          clamped_fixed(int64_t{bottom} - margin), clamped_fixed(int64_t{top} + margin)};
}

bool BlockLine::passes_through(const Box& other) const {
  // The two corners that lie farthest to either side of the line: which ones depends on its slope.
  const bool rising = (dx() >= 0) == (dy() >= 0);
  const int first = rising ? side_of(other.left, other.top) : side_of(other.right, other.top);
  const int second = rising ? side_of(other.right, other.bottom) : side_of(other.left, other.bottom);
  return first * second < 0;
}

bool BlockLine::crosses(const Box& other) const {
  if (x1 == x2 || y1 == y2) return passes_through(other);
  const bool rising = (dx() > 0) == (dy() > 0);
  return rising ? is_behind(other.left, other.top) != is_behind(other.right, other.bottom)
                : is_behind(other.right, other.top) != is_behind(other.left, other.bottom);
}

Blockmap Blockmap::build(const Level& level) {
  Blockmap map;
  map.lines_.reserve(level.linedefs.size());
  int64_t left = 0, right = 0, bottom = 0, top = 0;  // one step outside the vertices
  bool first = true;
  for (uint32_t index = 0; index < level.linedefs.size(); ++index) {
    const Linedef& linedef = level.linedefs[index];
    const Vertex& start = level.vertices[linedef.start];
    const Vertex& end = level.vertices[linedef.end];
    BlockLine line;
    line.x1 = start.x, line.y1 = start.y, line.x2 = end.x, line.y2 = end.y;
    line.box = Box::around_ends(start.x, start.y, end.x, end.y);
    line.front_sector = static_cast<int32_t>(level.sidedefs[linedef.front].sector_index);
    line.back_sector = linedef.back ? static_cast<int32_t>(level.sidedefs[*linedef.back].sector_index) : -1;
    line.flags = linedef.flags;
    line.linedef_index = index;
    const Box reach = line.box.grown(1);
    left = first ? reach.left : std::min<int64_t>(left, reach.left);
    right = first ? reach.right : std::max<int64_t>(right, reach.right);
    bottom = first ? reach.bottom : std::min<int64_t>(bottom, reach.bottom);
    top = first ? reach.top : std::max<int64_t>(top, reach.top);
    first = false;
    map.lines_.push_back(line);
  }
  map.origin_x_ = left, map.origin_y_ = bottom;
  map.columns_ = static_cast<int>(((right - left) >> (kFracBits + 7)) + 1);
  map.rows_ = static_cast<int>(((top - bottom) >> (kFracBits + 7)) + 1);

  // Two passes over the cells of every line: count, then fill. A sloped line enters only the cells
  // it crosses.
  std::vector<std::pair<uint32_t, uint32_t>> entries;  // cell, line
  for (uint32_t index = 0; index < map.lines_.size(); ++index) {
    const BlockLine& line = map.lines_[index];
    if (level.linedefs[index].in_polyobject) continue;
    const bool straight = line.x1 == line.x2 || line.y1 == line.y2;
    const Box reach = line.box.grown(1);  // on the edge of two cells it belongs to both
    for (int row = map.row_of(reach.bottom); row <= map.row_of(reach.top); ++row) {
      for (int column = map.column_of(reach.left); column <= map.column_of(reach.right); ++column) {
        const int64_t cell_left = map.origin_x_ + (int64_t{column} << (kFracBits + 7));
        const int64_t cell_bottom = map.origin_y_ + (int64_t{row} << (kFracBits + 7));
        const Box cell_box = {
            clamped_fixed(cell_left - 2), clamped_fixed(cell_left + to_fixed(kCellUnits) + 2),
            clamped_fixed(cell_bottom - 2), clamped_fixed(cell_bottom + to_fixed(kCellUnits) + 2)};
        if (straight || line.passes_through(cell_box))
          entries.emplace_back(static_cast<uint32_t>(row * map.columns_ + column), index);
      }
    }
  }
  const std::size_t cells = static_cast<std::size_t>(map.columns_) * map.rows_;
  map.cell_begin_.assign(cells + 1, 0);
  for (const auto& [cell, line] : entries) ++map.cell_begin_[cell + 1];
  for (std::size_t cell = 0; cell < cells; ++cell) map.cell_begin_[cell + 1] += map.cell_begin_[cell];
  map.cell_lines_.resize(entries.size());
  std::vector<uint32_t> next(map.cell_begin_.begin(), map.cell_begin_.end() - 1);
  for (const auto& [cell, line] : entries) map.cell_lines_[next[cell]++] = line;
  return map;
}

}  // namespace comrad::doom
