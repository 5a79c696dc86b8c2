#include "scenarios/spec/layout_content.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios {
namespace layout_content_test {

using testing::HasSubstr;

/// A room of a given width, with a script below the numbers that a recipe would write.
std::string wad_of(int32_t width, const std::string& numbers, const std::string& script,
                   const std::string& behavior = "ACSE") {
  doomgen::MapPlan plan;
  plan.add_area({.name = "room"}, doomgen::Box::around({0, 0}, width, 256));
  plan.add_start(1, {0, 0}, 90);
  const auto map = plan.build();
  EXPECT_TRUE(map) << map.error().message;
  doomgen::WadWriter wad;
  EXPECT_TRUE(
      wad.add_udmf_map("MAP01", doomgen::write_udmf(*map), behavior,
                       numbers.empty() ? "" : kLayoutScriptHead + ("toy.\n" + numbers) + "\n" + script));
  return *wad.bytes();
}

uint64_t content(const std::string& bytes) {
  const auto wad = wad::WadFile::from_bytes({bytes.begin(), bytes.end()}, "toy.wad");
  EXPECT_TRUE(wad) << wad.error().message;
  const auto hash = layout_content(*wad);
  EXPECT_TRUE(hash) << hash.error().message;
  return hash ? *hash : 0;
}

TEST(LayoutContent, TheSeedMakesNoOtherMapEvenWhereTheScriptReadsIt) {
  const std::string script = "script 1 OPEN { seed_random(LAYOUT_SEED); spawn(SPOTS); }\n";
  const auto map = [&](const char* seed, const char* spots) {
    return content(wad_of(256, std::string("#define LAYOUT_SEED ") + seed + "\n#define SPOTS " + spots + "\n",
                          script, std::string("compiled with ") + seed));
  };
  EXPECT_EQ(map("1", "3"), map("2", "3"));
  EXPECT_NE(map("1", "3"), map("1", "4"));
}

TEST(LayoutContent, NumbersThatTheScriptNamesCountAndOthersDoNot) {
  const auto map = [](const char* head, const char* script) { return content(wad_of(256, head, script)); };
  const char* const used = "int n = Lift_Speed;\n";  // ACS ignores the case of names
  EXPECT_NE(map("#define LIFT_SPEED 1\n", used), map("#define LIFT_SPEED 2\n", used));
  EXPECT_NE(map("int lift_speed[2] = {1, 2};\n", used), map("int lift_speed[2] = {1, 3};\n", used));
  for (const char* unused : {"int n = LIFT_SPEED_MAX;\n", "// LIFT_SPEED\n", "/* LIFT_SPEED\n */ int n;\n"})
    EXPECT_EQ(map("#define LIFT_SPEED 1\n", unused), map("#define LIFT_SPEED 2\n", unused)) << unused;
}

TEST(LayoutContent, GeometryCountsAndWithoutNumbersTheCompiledScriptDoes) {
  EXPECT_NE(content(wad_of(256, "", "")), content(wad_of(258, "", "")));
  EXPECT_NE(content(wad_of(256, "", "", "ACSE 1")), content(wad_of(256, "", "", "ACSE 2")));
  const std::string empty = *doomgen::WadWriter().bytes();
  EXPECT_THAT(
      layout_content(*wad::WadFile::from_bytes({empty.begin(), empty.end()}, "empty.wad")).error().message,
      HasSubstr("empty.wad: there is no map"));
}

class EveryScenario : public testing::TestWithParam<std::string> {};

TEST_P(EveryScenario, HasOneContentInBothFormats) {
  const auto udmf = generate_layout(GetParam(), {.seed = 7});
  const auto hexen = generate_layout(GetParam(), {.seed = 7, .format = MapFormat::kHexen});
  ASSERT_TRUE(udmf && hexen);
  EXPECT_EQ(udmf->map_hash, hexen->map_hash);
  EXPECT_EQ(udmf->map_hash, content(udmf->wad));
}

INSTANTIATE_TEST_SUITE_P(All, EveryScenario, testing::ValuesIn(layout_recipes()),
                         [](const auto& one) { return one.param; });

TEST(ContentSplitOf, OneContentInTenIsForEvaluation) {
  const auto split = ContentSplit::of("lava_pit");
  ASSERT_TRUE(split) << split.error().message;
  int eval = 0;
  for (uint64_t i = 0; i < 10'000; ++i) eval += split->is_for_evaluation(mix64(i));
  EXPECT_NEAR(eval, 1000, 120);
  for (const uint64_t seed : kHeldOutSeeds)
    EXPECT_TRUE(split->is_for_evaluation(generate_layout("lava_pit", {.seed = seed})->map_hash));
  EXPECT_FALSE(ContentSplit::of("no_such_scenario")->is_for_evaluation(10));
}

TEST(ContentSplitOf, PublishedCurriculaAreForTraining) {
  const auto split = ContentSplit::of("platform_chain");
  ASSERT_TRUE(split) << split.error().message;
  const LayoutRecipe recipe = *layout_recipe("platform_chain");
  ASSERT_EQ(recipe.curriculum.stages.size(), 12u);
  for (const CurriculumStage& stage : recipe.curriculum.stages) {
    const auto layout = generate_layout("platform_chain", stage_request(recipe.curriculum, stage));
    ASSERT_TRUE(layout) << layout.error().message;
    EXPECT_FALSE(split->is_for_evaluation(layout->map_hash)) << stage.name;
  }
}

TEST(DistinctMapsOf, SayWhetherTheyAreAllAnEstimateOrABound) {
  std::vector<uint64_t> contents;
  for (uint64_t i = 0; i < 300; ++i) contents.push_back(i % 6);
  EXPECT_EQ(distinct_maps(contents).kind, DistinctMaps::Kind::kAll);
  EXPECT_EQ(distinct_maps(contents).count, 6);
  EXPECT_EQ(distinct_maps_text(distinct_maps({5, 5, 5, 5, 5, 5, 5, 5, 5, 5})),
            "1 map (all there are: 10 draws gave each one several times)");
  contents.clear();
  for (uint64_t i = 0; i < 300; ++i) contents.push_back(i);
  EXPECT_EQ(distinct_maps(contents).kind, DistinctMaps::Kind::kAtLeast);
  EXPECT_EQ(distinct_maps(contents).count, 14'971) << "300 * 299 / (2 ln 20)";
  // Uniform draws from 1000 maps: the estimate comes near.
  contents.clear();
  Rng rng(RngKey(3));
  for (int i = 0; i < 1000; ++i) contents.push_back(rng.below(1000));
  EXPECT_EQ(distinct_maps(contents).kind, DistinctMaps::Kind::kEstimate);
  EXPECT_NEAR(static_cast<double>(distinct_maps(contents).count), 1000, 120);
}

}  // namespace layout_content_test
}  // namespace comrad::scenarios
