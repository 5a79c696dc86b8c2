// The tree's answers against the definition: a point lies in the sector whose outline goes round it.
#include "sim_workers/engine/map/sector_tree.h"

#include <gtest/gtest.h>

#include <array>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/map/level_index.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace sector_tree_test {

constexpr int kSide = 12, kSpacing = 64;

/// kSide x kSide crooked fields, each its own sector, with two-sided lines between them.
Level crooked_fields(uint64_t seed) {
  Rng rng(seed);
  Level level;
  for (int row = 0; row <= kSide; ++row)
    for (int column = 0; column <= kSide; ++column)
      level.vertices.push_back({to_fixed(column * kSpacing) + rng.between(-24 * kFracUnit, 24 * kFracUnit),
                                to_fixed(row * kSpacing) + rng.between(-24 * kFracUnit, 24 * kFracUnit)});
  level.sectors.resize(kSide * kSide);
  const auto vertex = [](int row, int column) { return static_cast<uint32_t>(row * (kSide + 1) + column); };
  const auto field = [](int row, int column) {
    return row < 0 || column < 0 || row >= kSide || column >= kSide ? -1 : row * kSide + column;
  };
  const auto add = [&](uint32_t start, uint32_t end, int right, int left) {
    if (right < 0) std::swap(start, end), std::swap(right, left);
    Linedef line;
    line.start = start, line.end = end;
    line.front = static_cast<uint32_t>(level.sidedefs.size());
    level.sidedefs.push_back({"-", "-", "-", 0, 0, static_cast<uint32_t>(right)});
    if (left >= 0) {
      line.back = static_cast<uint32_t>(level.sidedefs.size());
      level.sidedefs.push_back({"-", "-", "-", 0, 0, static_cast<uint32_t>(left)});
    }
    level.linedefs.push_back(line);
  };
  for (int row = 0; row <= kSide; ++row)
    for (int column = 0; column <= kSide; ++column) {
      if (column < kSide)
        add(vertex(row, column), vertex(row, column + 1), field(row - 1, column), field(row, column));
      if (row < kSide)
        add(vertex(row, column), vertex(row + 1, column), field(row, column), field(row, column - 1));
    }
  return level;
}

/// Even-odd rule over the lines that have `sector` on exactly one side.
bool inside(const Level& level, uint32_t sector, double x, double y) {
  bool is_inside = false;
  for (const Linedef& line : level.linedefs) {
    const bool front = level.sidedefs[line.front].sector_index == sector;
    const bool back = line.back && level.sidedefs[*line.back].sector_index == sector;
    if (front == back) continue;
    const double x1 = level.vertices[line.start].x, y1 = level.vertices[line.start].y;
    const double x2 = level.vertices[line.end].x, y2 = level.vertices[line.end].y;
    if ((y1 > y) != (y2 > y) && x < x1 + (y - y1) / (y2 - y1) * (x2 - x1)) is_inside = !is_inside;
  }
  return is_inside;
}

TEST(SectorTree, AgreesWithTheOutlinesOfCrookedFields) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Level level = crooked_fields(seed);
    const SectorTree tree = SectorTree::build(level);
    Rng rng(seed + 100);
    int compared = 0;
    for (int i = 0; i < 3000; ++i) {
      const Fixed x = rng.between(0, to_fixed(kSide * kSpacing)),
                  y = rng.between(0, to_fixed(kSide * kSpacing));
      const uint32_t found = tree.sector_at(x, y);
      ASSERT_LT(found, level.sectors.size());
      bool covered = false;
      for (uint32_t sector = 0; sector < level.sectors.size() && !covered; ++sector)
        covered = inside(level, sector, x, y);
      if (!covered) continue;  // outside the crooked rim
      ASSERT_TRUE(inside(level, found, x, y)) << to_double(x) << ", " << to_double(y) << " -> " << found;
      ++compared;
    }
    EXPECT_GT(compared, 2000);
    EXPECT_LT(tree.depth(), 40);
  }
}

TEST(SectorTree, FindsIslandsInsideSectors) {
  test::LevelBuilder builder;
  const uint32_t outer = builder.sector(0, 128), inner = builder.sector(16, 128),
                 core = builder.sector(32, 128);
  builder.room(outer, -256, -256, 256, 256).island(inner, outer, -128, -128, 128, 128);
  builder.island(core, inner, -32, -32, 32, 32).pillar(outer, 160, 160, 200, 200);
  const std::shared_ptr<const Level> level = builder.build();
  const auto at = [&](int x, int y) { return level->index->sectors.sector_at(to_fixed(x), to_fixed(y)); };
  EXPECT_EQ(at(0, 0), core);
  EXPECT_EQ(at(64, 0), inner);
  EXPECT_EQ(at(-100, 100), inner);
  EXPECT_EQ(at(200, 0), outer);
  EXPECT_EQ(at(220, 180), outer);
  EXPECT_LT(at(180, 180), 3u) << "the void has no sector, but the answer stays an index";
  EXPECT_LT(at(30000, -30000), 3u);
}

TEST(SectorTree, ALevelOfOneConvexRoomNeedsNoNode) {
  const std::shared_ptr<const Level> level = test::one_room();
  EXPECT_EQ(level->index->sectors.node_count(), 0u);
  EXPECT_EQ(level->index->sectors.sector_at(0, 0), 0u);
}

}  // namespace sector_tree_test
}  // namespace comrad::doom
