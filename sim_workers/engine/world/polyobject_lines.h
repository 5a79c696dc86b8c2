// Walls that move: the blockmap leaves them out. Stage: tic.
#pragma once

#include <algorithm>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Lines of polyobjects near a box, with their present ends. `visit(line, x1, y1, x2, y2)` returns false to stop.
template <typename Visit>
bool for_each_polyobject_line(const World& world, Fixed left, Fixed right, Fixed bottom, Fixed top,
                              Visit visit) {
  for (const Polyobject& polyobject : world.state().movers.polyobjects) {
    for (const uint32_t line : polyobject.lines) {
      const Linedef& linedef = world.level().linedefs[line];
      Fixed ends[4] = {0, 0, 0, 0};
      for (std::size_t i = 0; i < polyobject.vertices.size(); ++i) {
        if (polyobject.vertices[i] == linedef.start)
          ends[0] = polyobject.position[i][0], ends[1] = polyobject.position[i][1];
        if (polyobject.vertices[i] == linedef.end)
          ends[2] = polyobject.position[i][0], ends[3] = polyobject.position[i][1];
      }
      if (std::max(ends[0], ends[2]) < left || std::min(ends[0], ends[2]) > right) continue;
      if (std::max(ends[1], ends[3]) < bottom || std::min(ends[1], ends[3]) > top) continue;
      if (!visit(line, ends[0], ends[1], ends[2], ends[3])) return false;
    }
  }
  return true;
}

}  // namespace comrad::doom
