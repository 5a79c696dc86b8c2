#include "scenarios/spec/registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doomgen/wad/wad_reader.h"

namespace comrad::scenarios {
namespace registry_test {

using testing::HasSubstr;

TEST(LayoutRegistry, TheWadCarriesItsOwnDescription) {
  const auto layout =
      generate_layout("coop_health_gathering", {.seed = 7, .parameters = {{"tether", "320"}}});
  ASSERT_TRUE(layout) << layout.error().message;
  const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, "test.wad");
  ASSERT_TRUE(wad) << wad.error().message;
  const auto info = parse_layout_info(wad->text(*wad->find(kLayoutInfoLump)));
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->scenario, "coop_health_gathering");
  EXPECT_EQ(info->seed, 7u);
  EXPECT_EQ(info->parameter("tether", 0), 320);
  EXPECT_EQ(info->parameter("damage", 0), 5);
  EXPECT_THAT(wad->map_names(), testing::ElementsAre("MAP01"));
}

TEST(LayoutRegistry, BadRequestsSayWhatIsWrong) {
  const auto message = [](const std::string& scenario, const LayoutRequest& request) {
    const auto layout = generate_layout(scenario, request);
    return layout ? std::string("no error") : layout.error().message;
  };
  EXPECT_THAT(message("lava_lamp", {}), HasSubstr("coop_health_gathering"));
  EXPECT_THAT(message("coop_health_gathering", {.parameters = {{"thether", "1"}}}),
              HasSubstr("did you mean 'tether'"));
  EXPECT_THAT(message("coop_health_gathering", {.parameters = {{"tether", "long"}}}),
              HasSubstr("no whole number"));
  EXPECT_THAT(message("coop_health_gathering", {.parameters = {{"radius", "9000000"}}}),
              HasSubstr("800..8000"));
  EXPECT_THAT(message("coop_health_gathering", {.num_agents = 5}), HasSubstr("players"));
}

TEST(LayoutRegistry, EveryRecipeHasAScenario) {
  for (const std::string& name : layout_recipes()) EXPECT_TRUE(layout_parameters(name)) << name;
}

TEST(LayoutRegistry, TeamsUpToThePreparedSizeShareOneMap) {
  const auto two = generate_layout("coop_health_gathering", {.num_agents = 2});
  const auto four = generate_layout("coop_health_gathering", {.num_agents = 4});
  ASSERT_TRUE(two && four);
  EXPECT_EQ(two->content_hash, four->content_hash);
}

}  // namespace registry_test
}  // namespace comrad::scenarios
