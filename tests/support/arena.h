// A star-shaped arena full of pillars, of the size and shape that generated maps have, for collision and
// speed tests.
#pragma once

#include <cmath>

#include "rollout_buffer/core/rng.h"
#include "tests/support/level_builder.h"

namespace comrad::doom::test {

/// Arena of radius about 2000 with 18 corners and 90 pillars, floor tag 900, two starts in its free middle.
inline std::shared_ptr<const Level> star_arena(uint64_t seed = 1) {
  Rng rng(seed);
  LevelBuilder builder;
  const uint32_t sector = builder.sector(0, 384, 900);
  LevelBuilder::Points corners;
  constexpr int kCorners = 18;
  for (int i = 0; i < kCorners; ++i) {
    const double angle = -2 * M_PI * i / kCorners;  // clockwise
    const double radius = 1200 + 800 * rng.uniform();
    corners.emplace_back(static_cast<int>(radius * std::cos(angle)),
                         static_cast<int>(radius * std::sin(angle)));
  }
  builder.room(sector, corners);
  for (int i = 0; i < 90; ++i) {  // on a grid, so that no two overlap
    const int column = i % 10, row = i / 10;
    const int x = -800 + 170 * column + rng.between(0, 40), y = -800 + 180 * row + rng.between(0, 40);
    if (std::abs(x) < 256 && std::abs(y) < 256) continue;
    if (x * x + y * y > 1000 * 1000) continue;
    builder.pillar(sector, x, y, x + rng.between(48, 110), y + rng.between(48, 110));
  }
  builder.thing(1, -64, 0).thing(2, 64, 0, 180).thing(3, 0, 100, 270).thing(4, 0, -100, 90);
  return builder.build();
}

}  // namespace comrad::doom::test
