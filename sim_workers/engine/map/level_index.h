// What a Level's worlds share for collision: the grid of its linedefs, the tree that finds sectors, and the
// outline that separates the void (solid rock, also inside a pillar that is a hole of its sector) from the map.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "sim_workers/engine/map/blockmap.h"
#include "sim_workers/engine/map/sector_tree.h"

namespace comrad::doom {

/// The one-sided lines of a level: together they bound everything that can be stood in.
class Outline {
 public:
  static Outline build(const Level& level) {
    Outline outline;
    for (const Linedef& linedef : level.linedefs)
      if (!linedef.back && !linedef.in_polyobject)
        outline.edges_.push_back({level.vertices[linedef.start], level.vertices[linedef.end]});
    return outline;
  }

  /// True inside a sector, false in the void: an even-odd count of the edges east of the point. O(lines), so
  /// not for every move; a body that moves step by step cannot get into the void anyway.
  bool contains(Fixed x, Fixed y) const {
    bool inside = false;
    for (const Edge& edge : edges_) {
      if ((edge.start.y > y) == (edge.end.y > y)) continue;
      const __int128 run =
          static_cast<__int128>(int64_t{y} - edge.start.y) * (int64_t{edge.end.x} - edge.start.x);
      const __int128 rise =
          static_cast<__int128>(int64_t{x} - edge.start.x) * (int64_t{edge.end.y} - edge.start.y);
      if (edge.end.y > edge.start.y ? rise < run : rise > run) inside = !inside;
    }
    return inside;
  }

 private:
  struct Edge {
    Vertex start, end;
  };
  std::vector<Edge> edges_;
};

/// Remembers what a level's worlds have complained about, so that each special that is not supported is
/// reported once. No part of play. Threads: any.
class OncePerSpecial {
 public:
  /// True the first time for this number.
  bool first(int32_t number) {
    const uint32_t index = std::min(static_cast<uint32_t>(number), kCount - 1);
    return (bits_[index / 64].fetch_or(uint64_t{1} << (index % 64), std::memory_order_relaxed) >>
                (index % 64) &
            1) == 0;
  }

 private:
  static constexpr uint32_t kCount = 512;  // the last is for all others
  std::array<std::atomic<uint64_t>, kCount / 64> bits_{};
};

struct LevelIndex {
  Blockmap blockmap;
  SectorTree sectors;
  Outline outline;
  std::shared_ptr<OncePerSpecial> warned_specials = std::make_shared<OncePerSpecial>();

  static std::shared_ptr<const LevelIndex> build(const Level& level) {
    return std::make_shared<const LevelIndex>(LevelIndex{Blockmap::build(level), SectorTree::build(level),
                                                         Outline::build(level),
                                                         std::make_shared<OncePerSpecial>()});
  }
};

}  // namespace comrad::doom
