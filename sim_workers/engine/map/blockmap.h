// The linedefs of a level in a grid of 128-unit cells, packed for collision: which lines may touch a box, and
// on which side of a line a point lies. Built once per level, shared by all its worlds. Stage: tic.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/map/level.h"

namespace comrad::doom {

/// An axis-aligned box in map coordinates.
struct Box {
  Fixed left = 0, right = 0, bottom = 0, top = 0;

  /// The square of half side `radius` round (x, y), cut off at the ends of the number range.
  static Box around(Fixed x, Fixed y, Fixed radius) {
    return {clamped_fixed(int64_t{x} - radius), clamped_fixed(int64_t{x} + radius),
            clamped_fixed(int64_t{y} - radius), clamped_fixed(int64_t{y} + radius)};
  }
  /// What holds nothing, until it covers something.
  static Box nothing() { return {INT32_MAX, INT32_MIN, INT32_MAX, INT32_MIN}; }
  /// The smallest box that holds both points; of a line along an axis it has no width.
  static Box around_ends(Fixed x1, Fixed y1, Fixed x2, Fixed y2);
  /// With its sides moved outwards, cut off at the ends of the number range.
  Box grown(Fixed margin) const;
  /// Grows until it holds the other one, too.
  void cover(const Box& other) {
    left = std::min(left, other.left), right = std::max(right, other.right);
    bottom = std::min(bottom, other.bottom), top = std::max(top, other.top);
  }
  /// True where the interiors overlap, and where a box without width lies inside; touching edges do not count.
  bool overlaps(const Box& other) const {
    return right > other.left && left < other.right && top > other.bottom && bottom < other.top;
  }
};

/// What collision needs of a linedef, in one place.
struct BlockLine {
  Fixed x1 = 0, y1 = 0, x2 = 0, y2 = 0;
  Box box;  ///< round its ends
  int32_t front_sector = 0;
  int32_t back_sector = -1;  ///< -1: one-sided
  uint32_t flags = 0;
  uint32_t linedef_index = 0;

  int64_t dx() const { return int64_t{x2} - x1; }
  int64_t dy() const { return int64_t{y2} - y1; }
  /// +1 in front (right of start to end), -1 behind, 0 on the line; exact.
  int side_of(int64_t x, int64_t y) const {
    const __int128 cross = static_cast<__int128>(dy()) * (x - x1) - static_cast<__int128>(dx()) * (y - y1);
    return (cross > 0) - (cross < 0);
  }
  /// Whether the original engine takes (x, y) to be behind the line. It reads the side from the upper half of a
  /// product, so that a strip behind the line counts as before it: 1/16 unit for a line of 16, 1/64 for one of 64.
  bool is_behind(int64_t x, int64_t y) const {
    const __int128 area = static_cast<__int128>(y - y1) * dx() + static_cast<__int128>(x1 - x) * dy();
    return (area >> 32) > 0;
  }
  /// True where the endless line passes through the inside of `other`; exact.
  bool passes_through(const Box& other) const;
  /// True where a body that fills `other` is in the way of the endless line. For a slanted line the sides of the
  /// two corners are those of is_behind(), so that a body may reach over it by a little.
  bool crosses(const Box& other) const;
};

/// The grid itself. A position outside it belongs to the nearest cell at its rim.
class Blockmap {
 public:
  static constexpr int kCellUnits = 128;

  static Blockmap build(const Level& level);

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  int column_of(int64_t x) const { return cell_of(x - origin_x_, columns_); }
  int row_of(int64_t y) const { return cell_of(y - origin_y_, rows_); }
  /// Whether x lies exactly on the edge between two columns, counted from the westmost vertex; y and the
  /// rows likewise.
  bool on_column_edge(int64_t x) const { return on_edge(x - origin_x_); }
  bool on_row_edge(int64_t y) const { return on_edge(y - origin_y_); }
  const std::vector<BlockLine>& lines() const { return lines_; }

  /// Calls visit(line) for every line whose own box overlaps `box`, until it returns false. A line that lies
  /// in several cells may come more than once.
  template <typename Visit>
  void for_each_line(const Box& box, Visit&& visit) const {
    for_each_line_in_cells(box,
                           [&](const BlockLine& line) { return !line.box.overlaps(box) || visit(line); });
  }
  /// The same for every line in the cells that `box` touches.
  template <typename Visit>
  void for_each_line_in_cells(const Box& box, Visit&& visit) const {
    const int first_column = column_of(box.left), last_column = column_of(box.right);
    const int first_row = row_of(box.bottom), last_row = row_of(box.top);
    for (int row = first_row; row <= last_row; ++row) {
      for (int column = first_column; column <= last_column; ++column) {
        const std::size_t cell = static_cast<std::size_t>(row) * columns_ + column;
        for (uint32_t i = cell_begin_[cell]; i < cell_begin_[cell + 1]; ++i) {
          if (!visit(lines_[cell_lines_[i]])) return;
        }
      }
    }
  }

 private:
  static int cell_of(int64_t offset, int count) {
    return static_cast<int>(std::clamp<int64_t>(offset >> (kFracBits + 7), 0, count - 1));
  }

  /// The origin lies one step outside the vertices (see build()).
  static bool on_edge(int64_t offset) { return ((offset - 1) & ((int64_t{1} << (kFracBits + 7)) - 1)) == 0; }

  int64_t origin_x_ = 0, origin_y_ = 0;
  int columns_ = 1, rows_ = 1;
  std::vector<BlockLine> lines_;      // one per linedef, same index
  std::vector<uint32_t> cell_begin_;  // [cell] into cell_lines_, one more at the end
  std::vector<uint32_t> cell_lines_;
};

}  // namespace comrad::doom
