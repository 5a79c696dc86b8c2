// Levels of several sectors for pictures: LevelBuilder's two-sided lines with steps in place of gratings.
#pragma once

#include <memory>

#include "tests/support/level_builder.h"

namespace comrad::doom::test {

/// `level` with nothing in the openings of its two-sided lines and `step` above and below them.
inline std::shared_ptr<const Level> with_open_lines(const std::shared_ptr<const Level>& level,
                                                    const char* step = "ASHWALL6") {
  Level open = *level;
  for (const Linedef& line : open.linedefs) {
    if (!line.back) continue;
    for (const uint32_t side : {line.front, *line.back}) {
      open.sidedefs[side].middle = "-";
      open.sidedefs[side].top = open.sidedefs[side].bottom = step;
    }
  }
  return std::make_shared<const Level>(std::move(open));
}

}  // namespace comrad::doom::test
