// In which sector a point lies: a binary tree of linedefs, each node one exact side test. Built once per
// level from the linedefs alone (no nodes lump needed). Stage: tic, and code that places things.
#pragma once

#include <cstdint>
#include <vector>

#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/map/level.h"

namespace comrad::doom {

class SectorTree {
 public:
  static SectorTree build(const Level& level);

  /// Index of the sector at (x, y); a point on a line along an axis lies west or south of it, one on another line behind it, one in
  /// the void in a sector near by.
  uint32_t sector_at(Fixed x, Fixed y) const {
    int32_t node_index = root_;
    while (node_index >= 0) {
      const Node& node = nodes_[static_cast<std::size_t>(node_index)];
      const __int128 cross = static_cast<__int128>(node.dy) * (int64_t{x} - node.x) -
                             static_cast<__int128>(node.dx) * (int64_t{y} - node.y);
      node_index = cross >= 0 ? node.front : node.back;
    }
    return static_cast<uint32_t>(~node_index);
  }
  std::size_t node_count() const { return nodes_.size(); }
  int depth() const { return depth_; }

 private:
  friend class SectorTreeBuilder;
  struct Node {
    int64_t dx = 0, dy = 0;
    Fixed x = 0, y = 0;
    int32_t front = -1, back = -1;  // a node, or ~sector
  };
  std::vector<Node> nodes_;
  int32_t root_ = -1;  // ~0: sector 0
  int depth_ = 0;
};

}  // namespace comrad::doom
