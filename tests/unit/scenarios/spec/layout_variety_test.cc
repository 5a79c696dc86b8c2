// What the seed varies where a pool requests it: at least ten thousand geometries each, within the rules that
// the recipe's checks keep, and the published map where nothing is varied.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "scenarios/spec/layout_content.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios {
namespace layout_variety_test {

/// All different: at least 260 * 259 / (2 ln 20) = 11 239 maps.
constexpr int kManySeeds = 260, kFewSeeds = 26;
constexpr int64_t kManyMaps = 10'000, kFewMaps = 100;

/// TEXTMAP of each default map, seed 42, as it was before there was any variety.
const std::map<std::string, uint64_t> kPublishedMaps = {
    {"armory_siege", 0xbea6854e36aa2578ull}, {"coop_puzzle", 0xabf3611894c3ad81ull},
    {"lava_maze", 0x15377c9d36c8fe67ull},    {"platform_chain", 0xdbb851710fe678efull},
    {"rhythm_sync", 0x19f663faf117a302ull},  {"stag_hunt_arena", 0xc6bc2f2c52958448ull},
};

std::vector<std::string> varied_recipes() {
  std::vector<std::string> names;
  for (const std::string& name : layout_recipes())
    if (!layout_recipe(name)->pool_values.empty()) names.push_back(name);
  return names;
}

/// The map without what is only painted on it.
uint64_t geometry_of(doomgen::MapData map) {
  for (doomgen::SectorData& sector : map.sectors) {
    sector.floor_texture = sector.ceiling_texture = "X";
    sector.light = 160;
  }
  for (doomgen::SidedefData& side : map.sidedefs) side.top = side.middle = side.bottom = "X";
  return doomgen::content_hash(doomgen::write_udmf(map));
}

class VariedRecipe : public testing::TestWithParam<std::string> {
 protected:
  /// Of so many seeds nearly all make a map, and so many maps there are at least, by how few are alike.
  void expect_geometries(int seeds, int64_t maps_at_least) const {
    std::vector<uint64_t> geometries;
    int refused = 0;
    for (uint64_t seed = 0; seed < static_cast<uint64_t>(seeds); ++seed) {
      const auto drawn = recipe_.draw(draw_of(seed, true));
      if (drawn)
        geometries.push_back(geometry_of(drawn->map));
      else
        ++refused;
    }
    EXPECT_LE(refused, seeds / 20);
    const DistinctMaps maps = distinct_maps(geometries);
    EXPECT_EQ(maps.distinct, maps.draws);
    EXPECT_GE(maps.count, maps_at_least) << distinct_maps_text(maps);
  }
  LayoutDraw draw_of(uint64_t seed, bool vary) const {
    LayoutDraw draw{seed, {}, RngKey(seed).split(GetParam()), 0};
    for (const LayoutParameter& p : recipe_.parameters) draw.values[p.name] = p.default_value;
    if (vary)
      for (const auto& [name, value] : recipe_.pool_values) draw.values[name] = value;
    return draw;
  }
  const LayoutRecipe recipe_ = *layout_recipe(GetParam());
};

TEST_P(VariedRecipe, MakesManyGeometriesFromOneSetOfParameters) { expect_geometries(kFewSeeds, kFewMaps); }

using VariedRecipeLong = VariedRecipe;
TEST_P(VariedRecipeLong, MakesTenThousandGeometriesFromOneSetOfParameters) {
  expect_geometries(kManySeeds, kManyMaps);
}

TEST_P(VariedRecipe, IsThePublishedMapWhereNothingIsVaried) {
  const auto drawn = recipe_.draw(draw_of(42, false));
  ASSERT_TRUE(drawn) << drawn.error().message;
  ASSERT_TRUE(kPublishedMaps.contains(GetParam()));
  EXPECT_EQ(doomgen::content_hash(doomgen::write_udmf(drawn->map)), kPublishedMaps.at(GetParam()));
}

TEST_P(VariedRecipe, CanBeDrawnAgainFromWhatTheWadRecords) {
  LayoutRequest request{.seed = 5};
  for (const auto& [name, value] : recipe_.pool_values)
    request.parameters.emplace_back(name, std::to_string(value));
  const auto layout = generate_layout(GetParam(), request);
  ASSERT_TRUE(layout) << layout.error().message;
  LayoutRequest again{.seed = layout->info.seed};
  for (const auto& [name, value] : layout->info.parameters)
    again.parameters.emplace_back(name, std::to_string(value));
  EXPECT_EQ(generate_layout(GetParam(), again)->wad, layout->wad);
  const auto plain = generate_layout(GetParam(), {.seed = 5});
  EXPECT_NE(plain->map_hash, layout->map_hash);
  EXPECT_FALSE(plain->info.parameters.contains("variety")) << "WADs from before it keep their bytes";
}

const auto kName = [](const auto& one) { return one.param; };
INSTANTIATE_TEST_SUITE_P(All, VariedRecipe, testing::ValuesIn(varied_recipes()), kName);
INSTANTIATE_TEST_SUITE_P(All, VariedRecipeLong, testing::ValuesIn(varied_recipes()), kName);

TEST(VariedRecipes, AreTheSixWhosePublishedSeedHardlyVaries) {
  std::vector<std::string> names;
  for (const auto& [name, hash] : kPublishedMaps) names.push_back(name);
  EXPECT_EQ(varied_recipes(), names);
}

/// Recipes whose maps were published with walls along random cells.
constexpr std::size_t kOrganicSeeds = 6;
const std::vector<std::string> kOrganicRecipes = {"ammo_carrier", "dumb_enemies",  "lava_maze",
                                                  "lava_pit",     "smart_enemies", "stealth_labyrinth"};

TEST(OrganicRecipes, FollowRandomCellsWhereTheyAreAskedTo) {
  for (const std::string& name : layout_recipes()) {
    SCOPED_TRACE(name);
    const auto jagged = generate_layout(name, {.seed = 42, .parameters = {{"organic", "1"}}});
    const auto listed = std::find(kOrganicRecipes.begin(), kOrganicRecipes.end(), name);
    if (listed == kOrganicRecipes.end()) {
      EXPECT_THAT(jagged.error().message, testing::HasSubstr("no layout parameter 'organic'"));
      continue;
    }
    ASSERT_TRUE(jagged) << jagged.error().message;
    const auto plain = generate_layout(name, {.seed = 42});
    EXPECT_GT(jagged->wad.size(), 2 * plain->wad.size()) << "one line for each cell along a wall";
    EXPECT_NE(jagged->map_hash, plain->map_hash);
    EXPECT_FALSE(plain->info.parameters.contains("organic"));
    // The cells come from the seed; nearly every seed gives a valid map.
    const LayoutRecipe recipe = *layout_recipe(name);
    std::set<uint64_t> maps;
    for (uint64_t seed = 0; seed < kOrganicSeeds; ++seed) {
      LayoutDraw draw{seed, {}, RngKey(seed).split(name), 0};
      for (const LayoutParameter& p : recipe.parameters) draw.values[p.name] = p.default_value;
      draw.values["organic"] = 1;
      if (const auto drawn = recipe.draw(draw))
        maps.insert(doomgen::content_hash(doomgen::write_udmf(drawn->map)));
    }
    EXPECT_GE(maps.size(), kOrganicSeeds - 1);
  }
}

TEST(BentBox, KeepsItsCornersAndBendsWithinItsBounds) {
  Rng rng(RngKey(1));
  const doomgen::Polygon outline = bent_box(doomgen::Box{{-100, -200}, {300, 200}}, 3, 20, 10, rng);
  ASSERT_EQ(outline.size(), 16u);
  EXPECT_EQ(outline[0], (doomgen::Point{-100, -200}));
  EXPECT_EQ(outline[8], (doomgen::Point{300, 200}));
  bool is_bent = false;
  for (const doomgen::Point& p : outline) {
    EXPECT_TRUE(p.x >= -110 && p.x <= 310 && p.y >= -210 && p.y <= 210) << p.x << ", " << p.y;
    EXPECT_FALSE(p.x > -80 && p.x < 280 && p.y > -180 && p.y < 180) << p.x << ", " << p.y;
    is_bent |= p.x != -100 && p.x != 300 && p.y != -200 && p.y != 200;
  }
  EXPECT_TRUE(is_bent);
  EXPECT_GT(doomgen::twice_area(outline), 0);
}

}  // namespace layout_variety_test
}  // namespace comrad::scenarios
