// What a Level's worlds share for collision: the grid of its linedefs and the tree that finds sectors.
#pragma once

#include <memory>

#include "sim_workers/engine/map/blockmap.h"
#include "sim_workers/engine/map/sector_tree.h"

namespace comrad::doom {

struct LevelIndex {
  Blockmap blockmap;
  SectorTree sectors;

  static std::shared_ptr<const LevelIndex> build(const Level& level) {
    return std::make_shared<const LevelIndex>(LevelIndex{Blockmap::build(level), SectorTree::build(level)});
  }
};

}  // namespace comrad::doom
