// Every recipe's maps, as the engine reads them: the same sectors in the same places, back-to-back walls and
// control areas of polyobjects included.
#include <gtest/gtest.h>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/map/sector_tree.h"

namespace comrad::doom {
namespace generated_maps_test {

class GeneratedMaps : public testing::TestWithParam<std::string> {};

TEST_P(GeneratedMaps, EveryPointLiesInTheSectorItWasDrawnIn) {
  const scenarios::LayoutRecipe recipe = *scenarios::layout_recipe(GetParam());
  for (const uint64_t seed : {42, 7, 1009}) {
    SCOPED_TRACE(seed);
    scenarios::LayoutDraw draw{seed, {}, RngKey(seed).split(GetParam()), 0};
    for (const scenarios::LayoutParameter& p : recipe.parameters) draw.values[p.name] = p.default_value;
    const auto drawn = recipe.draw(draw);
    const auto layout = scenarios::generate_layout(GetParam(), {.seed = seed});
    if (!drawn || !layout || layout->info.attempt != 0) continue;
    const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, "test.wad");
    ASSERT_TRUE(wad);
    const auto level = load_level(*wad);
    ASSERT_TRUE(level) << level.error().message;
    const SectorTree tree = SectorTree::build(**level);
    const doomgen::MapData& map = drawn->map;
    ASSERT_EQ((*level)->sectors.size(), map.sectors.size());
    const doomgen::Box box = doomgen::bounds_of(map.vertices);
    Rng rng(seed);
    int compared = 0;
    for (int i = 0; i < 4000; ++i) {
      const doomgen::Point p{rng.between(box.low.x, box.high.x), rng.between(box.low.y, box.high.y)};
      const int sector = doomgen::sector_at(map, p);
      if (sector < 0) continue;
      const bool on_line =
          std::any_of(map.linedefs.begin(), map.linedefs.end(), [&](const doomgen::LinedefData& line) {
            return doomgen::nearer_than(p, map.vertices[line.start], map.vertices[line.end], 1);
          });
      if (on_line) continue;
      ++compared;
      ASSERT_EQ(tree.sector_at(p.x * 65536, p.y * 65536), static_cast<uint32_t>(sector))
          << p.x << ", " << p.y;
    }
    EXPECT_GT(compared, 200);
  }
}

INSTANTIATE_TEST_SUITE_P(All, GeneratedMaps, testing::ValuesIn(scenarios::layout_recipes()),
                         [](const auto& one) { return one.param; });

}  // namespace generated_maps_test
}  // namespace comrad::doom
