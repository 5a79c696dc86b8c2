// Jagged outlines: the plane as cells around scattered points, made even by a few Lloyd steps. Areas then
// take whole cells, and walls follow the cells. All of it is integer arithmetic.
#pragma once

#include <cstdint>
#include <vector>

#include "doomgen/layout/geometry.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::doomgen {

/// A ridge between two cells, from one corner of the diagram to the next.
struct CellRidge {
  Point start, end;
  int right = 0, left = 0;  ///< cells; `right` lies to the right of start -> end
};

struct CellField {
  std::vector<Point> seeds;  ///< one for each cell; those of the frame come last
  int inner_count = 0;       ///< cells that areas may take; the others close the diagram
  std::vector<CellRidge> ridges;

  /// The cell whose seed is nearest to `p`, the first one of several.
  int cell_at(Point p) const;

  // Seeds by square of the plane, row by row; for cell_at().
  Box bucket_bounds;
  int32_t bucket_side = 1, bucket_columns = 0, bucket_rows = 0;
  std::vector<std::vector<int>> buckets;
};

/// A field of `cell_count` cells inside `bounds`, after `lloyd_steps` steps that move each point to the mean
/// of its cell's corners. Corners nearer than `weld` units are made one. Threads: pure function.
CellField make_cell_field(const Box& bounds, int cell_count, RngKey key, int lloyd_steps = 5,
                          int32_t weld = 3);

/// The triangles of the Delaunay triangulation of distinct points, counter-clockwise, by index.
struct Triangle {
  int corner[3];
  int neighbour[3];  ///< across the edge that lies opposite to the corner; -1 at the rim
};
std::vector<Triangle> triangulate(const std::vector<Point>& points);

}  // namespace comrad::doomgen
