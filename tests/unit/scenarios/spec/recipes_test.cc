// What every scenario's recipe and file keeps, whichever scenarios there are.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_validation.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace recipes_test {

using testing::AllOf;
using testing::HasSubstr;

class EveryRecipe : public testing::TestWithParam<std::string> {};

LayoutDraw draw_of(const std::string& name, const LayoutRecipe& recipe, uint64_t seed, bool vary) {
  LayoutDraw draw{seed, {}, RngKey(seed).split(name), 0};
  for (const LayoutParameter& p : recipe.parameters) draw.values[p.name] = p.default_value;
  Rng rng(RngKey(seed).split("axes"));
  if (vary)
    for (const auto& [key, value] : recipe.pool_values) draw.values[key] = value;
  if (vary)
    for (const LayoutAxis& axis : recipe.axes)
      for (const auto& [key, value] : axis.options[rng.below(static_cast<uint32_t>(axis.options.size()))])
        draw.values[key] = value;
  return draw;
}

TEST_P(EveryRecipe, SeedsGiveValidMapsAndTheSameOnesAgain) {
  const LayoutRecipe recipe = *layout_recipe(GetParam());
  int refused = 0;
  constexpr int kSeeds = 20;  // thousand_layouts_test (long) draws more
  for (const bool vary : {false, true})
    for (uint64_t seed = 0; seed < kSeeds; ++seed) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << (vary ? ", axes drawn" : ", defaults"));
      const LayoutDraw wanted = draw_of(GetParam(), recipe, seed, vary);
      const auto drawn = recipe.draw(wanted);
      if (!drawn) {
        ++refused;
        EXPECT_FALSE(drawn.error().message.empty());
        continue;
      }
      ASSERT_TRUE(doomgen::validate_map(drawn->map));
      if (seed % 10 != 0) continue;
      const auto again = recipe.draw(wanted);
      ASSERT_TRUE(again);
      ASSERT_EQ(doomgen::write_udmf(drawn->map), doomgen::write_udmf(again->map));
    }
  EXPECT_LE(refused, 2 * kSeeds / 20);
}

TEST_P(EveryRecipe, ParametersAndAxesAgree) {
  const LayoutRecipe recipe = *layout_recipe(GetParam());
  std::map<std::string, LayoutParameter> known;
  for (const LayoutParameter& p : recipe.parameters) {
    EXPECT_TRUE(known.emplace(p.name, p).second) << p.name;
    EXPECT_LE(p.low, p.default_value) << p.name;
    EXPECT_GE(p.high, p.default_value) << p.name;
  }
  std::set<std::string> used;
  for (const LayoutAxis& axis : recipe.axes) {
    std::set<std::string> here;
    for (const auto& option : axis.options)
      for (const auto& [name, value] : option) {
        here.insert(name);
        ASSERT_TRUE(known.contains(name)) << axis.name << ": " << name;
        EXPECT_GE(value, known.at(name).low) << name;
        EXPECT_LE(value, known.at(name).high) << name;
      }
    for (const auto& [name, value] : recipe.pool_values) {
      ASSERT_TRUE(known.contains(name)) << name;
      EXPECT_FALSE(here.contains(name)) << "a pool sets " << name << " twice";
      EXPECT_TRUE(value >= known.at(name).low && value <= known.at(name).high) << name;
    }
    for (const std::string& name : here) EXPECT_TRUE(used.insert(name).second) << "two axes set " << name;
  }
}

TEST_P(EveryRecipe, EveryStageOfItsCurriculumHasAValueForEachParameter) {
  const CurriculumRecipe curriculum = layout_recipe(GetParam())->curriculum;
  for (const CurriculumStage& stage : curriculum.stages)
    if (!stage.values.empty()) {
      EXPECT_EQ(stage.values.size(), curriculum.parameters.size()) << stage.name;
    }
}

TEST_P(EveryRecipe, TheWadHoldsTheMapInEitherFormat) {
  for (const MapFormat format : {MapFormat::kUdmf, MapFormat::kHexen}) {
    const auto layout = generate_layout(GetParam(), {.seed = 42, .format = format});
    ASSERT_TRUE(layout) << layout.error().message;
    const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, "test.wad");
    ASSERT_TRUE(wad) << wad.error().message;
    const auto lumps = wad->find_map("MAP01");
    ASSERT_TRUE(lumps) << lumps.error().message;
    EXPECT_EQ(lumps->textmap.has_value(), format == MapFormat::kUdmf);
    const auto map = lumps->textmap ? wad::parse_udmf(wad->text(*lumps->textmap), "test")
                                    : wad::read_binary_map(*wad, *lumps, "test");
    ASSERT_TRUE(map) << map.error().message;
    EXPECT_GT(map->linedefs.size(), 3u);
    const auto info = parse_layout_info(wad->text(*wad->find(kLayoutInfoLump)));
    ASSERT_TRUE(info) << info.error().message;
    EXPECT_EQ(info->scenario, GetParam());
  }
}

TEST_P(EveryRecipe, ItsScenarioFileIsWholeAndItsTeamsFindStarts) {
  const auto spec = load_scenario(GetParam());
  ASSERT_TRUE(spec) << spec.error().message;
  for (const int agents : spec->supported_agents) {
    const auto layout = generate_layout(GetParam(), {.num_agents = agents});
    EXPECT_TRUE(layout) << agents << " agents: " << layout.error().message;
  }
}

INSTANTIATE_TEST_SUITE_P(All, EveryRecipe, testing::ValuesIn(layout_recipes()),
                         [](const auto& one) { return one.param; });

TEST_P(EveryRecipe, ItsScenarioFileHasTheCeilingOfTheDefaultMap) {
  const auto spec = load_scenario(GetParam());
  ASSERT_TRUE(spec) << spec.error().message;
  const auto ceilings = default_ceilings(*spec);
  ASSERT_TRUE(ceilings) << ceilings.error().message;
  EXPECT_NEAR(ceilings->at(spec->default_agents), spec->ceiling, 1e-9);
  for (const int agents : spec->supported_agents)
    EXPECT_TRUE(ceilings->contains(agents)) << "the default map is not enough for " << agents;
}

/// Ceilings are the published ones, but for three: Armory Siege's 100 lies below what a scripted team gets,
/// Smart Enemies' 84 and Dumb Enemies' 90 are not what two agents can have of 172 demons.
TEST(ScenarioFiles, ActionSpacesLimitsAndCeilingsAreThePublishedOnes) {
  struct Row {
    int difficulty;
    int64_t actions;
    int measurements, limit;
    double alpha, ceiling;
  };
  const std::map<std::string, Row> published = {
      {"stag_hunt_arena", {1, 54, 0, 4500, 0, 36}},
      {"rhythm_sync", {3, 54, 10, 1750, 1, 1}},
      {"foraging_commons", {3, 27, 8, 5250, 0, 21000}},
      {"coop_puzzle", {3, 18, 0, 2000, 1, 5}},
      {"platform_chain", {4, 54, 0, 5250, 1, 47}},
      {"armory_siege", {4, 162, 9, 4500, 0, 1123.47}},
      {"coop_health_gathering", {4, 27, 0, 2100, 0, 8400}},
      {"lava_pit", {5, 36, 0, 1000, 1, 11}},
      {"smart_enemies", {5, 54, 0, 4500, 0, 172}},
      {"dumb_enemies", {5, 54, 0, 4500, 0, 172}},
      {"ammo_carrier", {6, 36, 10, 2100, 0, 8400}},
      {"stealth_labyrinth", {7, 54, 0, 5250, 1, 1}},
      {"lava_maze", {7, 90, 7, 5250, 1, 6}},
  };
  for (const std::string& name : list_scenarios()) {
    SCOPED_TRACE(name);
    const auto spec = load_scenario(name);
    ASSERT_TRUE(spec) << spec.error().message;
    const auto row = published.find(name);
    if (row == published.end()) continue;  // a user's scenario
    const EnvShape shape = spec->shape(spec->default_agents, true);
    EXPECT_EQ(spec->difficulty, row->second.difficulty);
    EXPECT_EQ(shape.joint_action_count(), row->second.actions);
    EXPECT_EQ(shape.measurement_count, row->second.measurements);
    EXPECT_EQ(spec->decision_limit, row->second.limit);
    EXPECT_EQ(spec->shared_reward_alpha, row->second.alpha);
    EXPECT_EQ(spec->ceiling, row->second.ceiling);
    EXPECT_EQ(spec->default_agents, 2);
  }
}

TEST(Ceilings, FollowTheParametersAndTheTeam) {
  const auto of = [](const std::string& scenario, int agents,
                     std::vector<std::pair<std::string, std::string>> parameters) {
    const auto layout = generate_layout(scenario, {.parameters = std::move(parameters)});
    EXPECT_TRUE(layout) << layout.error().message;
    return layout ? layout->info.ceiling.at(agents) : 0.0;
  };
  EXPECT_EQ(of("platform_chain", 2, {{"levels", "36"}}), 35);
  EXPECT_EQ(of("platform_chain", 2, {{"levels", "60"}}), 59);
  EXPECT_EQ(of("coop_puzzle", 2, {{"zones", "12"}}), 6);
  EXPECT_EQ(of("lava_pit", 2, {{"platforms", "14"}}), 13);
  EXPECT_EQ(of("lava_maze", 2, {{"initial", "6"}, {"maximum", "25"}}), 10);
  EXPECT_EQ(of("lava_maze", 2, {{"initial", "10"}, {"maximum", "4"}}), 1)
      << "the first path is always walked";
  EXPECT_EQ(of("stag_hunt_arena", 4, {{"stag_respawn", "420"}, {"stag_first", "210"}}), 42);
  EXPECT_EQ(of("coop_health_gathering", 3, {}), 8400);
  // 172 demons come; with one every 4 s the floor takes more than they bring, and the
  // team dies at clock 8 096, after 58 demons at most: 100 + 58 * 7 health against 253 hits of 2.
  EXPECT_DOUBLE_EQ(of("smart_enemies", 3, {}), 172);
  EXPECT_DOUBLE_EQ(of("dumb_enemies", 4, {}), 172);
  EXPECT_DOUBLE_EQ(of("smart_enemies", 2, {{"interval", "2"}, {"cap", "7"}}), 258);
  ParameterValues slow;
  const LayoutRecipe hunt = *layout_recipe("dumb_enemies");
  for (const LayoutParameter& parameter : hunt.parameters) slow[parameter.name] = parameter.default_value;
  slow["interval"] = 4;
  EXPECT_DOUBLE_EQ(hunt.ceiling({slow, 2, 18000}), 58) << "no such map is made";
  EXPECT_GT(of("armory_siege", 2, {{"window", "450"}, {"difficulty", "1000"}}),
            of("armory_siege", 2, {{"window", "450"}}));
  EXPECT_LT(of("armory_siege", 8, {}), of("armory_siege", 2, {}))
      << "pellets and supplies are shared out, kills are not";
}

TEST(Resources, AMapThatGivesTooLittleIsRefusedWithAReason) {
  const auto error = [](const std::string& scenario, int agents,
                        std::vector<std::pair<std::string, std::string>> parameters) {
    const auto layout =
        generate_layout(scenario, {.num_agents = agents, .parameters = std::move(parameters)});
    if (layout) return std::string("no error");
    EXPECT_EQ(layout.error().code, ErrorCode::kUnsupported);
    return layout.error().message;
  };
  // 3 branches of (110 + 2 * 180) * 2: 2 820 health against 240 bullets of 10.
  const std::string bullets = error(
      "stealth_labyrinth", 2,
      {{"branches", "3"}, {"rooms", "3"}, {"turrets_low", "2"}, {"health", "180"}, {"first_health", "110"}});
  EXPECT_THAT(bullets, AllOf(HasSubstr("cannot be solved by 2 agents"), HasSubstr("18 turrets of 2820"),
                             HasSubstr("288 hits"), HasSubstr("240 bullets"), HasSubstr("lower health")));
  EXPECT_EQ(error("stealth_labyrinth", 2, {{"branches", "3"}, {"rooms", "3"}}), "no error");
  const std::vector<std::pair<std::string, std::string>> poor = {
      {"start_rate", "70"}, {"harvest_cost", "3"}, {"decay", "2"}, {"boost", "12"}, {"cleanup_tics", "88"}};
  EXPECT_THAT(error("foraging_commons", 2, poor),
              AllOf(HasSubstr("of their time and cleaning"), HasSubstr("raise boost")));
  EXPECT_THAT(error("foraging_commons", 2, {{"drain", "20"}}), HasSubstr("bonuses that they can get"));
  EXPECT_EQ(error("foraging_commons", 4, {{"drain", "0"}, {"decay", "0"}, {"boost", "0"}}), "no error");
  EXPECT_THAT(error("ammo_carrier", 2, {{"density", "4000"}}), HasSubstr("2210 appear"));
  EXPECT_EQ(error("ammo_carrier", 2, {{"density", "1250"}, {"depots", "3"}}), "no error");
  EXPECT_THAT(error("coop_health_gathering", 4, {{"damage", "8"}}),
              HasSubstr("more than 4 agents can fetch"));
  // What the published axes have: three cannot live on it, two can.
  const std::vector<std::pair<std::string, std::string>> hot = {{"radius", "2400"}};
  EXPECT_THAT(error("coop_health_gathering", 3, hot),
              HasSubstr("falls to 78 health on average (80 are needed)"));
  EXPECT_EQ(error("coop_health_gathering", 2, hot), "no error");
  for (const int agents : {2, 3, 4}) EXPECT_EQ(error("coop_health_gathering", agents, {}), "no error");
  EXPECT_THAT(error("coop_health_gathering", 2, {{"damage", "7"}, {"kit_cap", "20"}, {"radius", "3000"}}),
              HasSubstr("or take fewer agents"));
  EXPECT_THAT(error("armory_siege", 2, {{"window", "12"}}), HasSubstr("13 at least"));
  // 562 hits of 2 less 100 health need 147 kills of 7; at one demon every 4 s there are 129.
  for (const char* hunt : {"smart_enemies", "dumb_enemies"})
    for (const int agents : {2, 3, 4}) {
      EXPECT_EQ(error(hunt, agents, {}), "no error");
      EXPECT_THAT(
          error(hunt, agents, {{"interval", "4"}}),
          AllOf(HasSubstr("takes 1124 health in all"), HasSubstr("147 demons"), HasSubstr("129 come")));
    }
  EXPECT_THAT(error("smart_enemies", 2, {{"interval", "2"}, {"cap", "3"}}), HasSubstr("on the default map"));
  EXPECT_THAT(error("dumb_enemies", 2, {{"radius", "1150"}, {"cap", "6"}}), HasSubstr("can be caught"));
}

TEST(Resources, ASiegeIsMadeForTeamsWhoseShotsAndShellsSuffice) {
  const auto is_made = [](int agents, const char* window, const char* difficulty) {
    const auto layout = generate_layout(
        "armory_siege",
        {.num_agents = agents, .parameters = {{"window", window}, {"difficulty", difficulty}}});
    if (!layout) {
      EXPECT_THAT(layout.error().message, HasSubstr("of the monsters before the core falls"));
    }
    return layout.has_value();
  };
  for (int agents = 2; agents <= 8; ++agents) {
    EXPECT_TRUE(is_made(agents, "300", "500")) << "the default map is the measure";
    // Twice the health and no more shells: they run out for every team.
    EXPECT_FALSE(is_made(agents, "300", "1000")) << agents;
  }
  // Waves come twice as fast: two cannot fire so often. Shells come twice as fast as well.
  EXPECT_FALSE(is_made(2, "150", "500"));
  EXPECT_TRUE(is_made(3, "150", "500"));
  EXPECT_FALSE(is_made(3, "150", "1000"));
  EXPECT_TRUE(is_made(4, "150", "1000"));
}

TEST(Resources, HuntersWithoutRoomToKeepApartGetNoMap) {
  // Walls shut most of the arena off: of 20 seeds none leaves four hunters 640 units from one another's demons.
  const auto layout = generate_layout(
      "smart_enemies",
      {.num_agents = 4, .parameters = {{"radius", "700"}, {"obstacles", "42"}, {"proximity", "640"}}});
  ASSERT_FALSE(layout);
  EXPECT_EQ(layout.error().code, ErrorCode::kUnsupported);
  EXPECT_THAT(layout.error().message, AllOf(HasSubstr("there is room for"), HasSubstr("not for 4")));
  const auto pair = generate_layout("smart_enemies", {.num_agents = 2, .parameters = {{"proximity", "700"}}});
  ASSERT_TRUE(pair) << pair.error().message;
  EXPECT_TRUE(pair->info.ceiling.contains(2));
  EXPECT_FALSE(pair->info.ceiling.contains(4)) << "a larger team has no ceiling on it";
}

TEST(Resources, TeamSizesThatAMapIsNotEnoughForHaveNoCeiling) {
  // 2 agents live where 4 do not: kits come for all.
  const auto layout =
      generate_layout("coop_health_gathering", {.num_agents = 2, .parameters = {{"radius", "2400"}}});
  ASSERT_TRUE(layout) << layout.error().message;
  EXPECT_TRUE(layout->info.ceiling.contains(2));
  EXPECT_FALSE(layout->info.ceiling.contains(4));
}

TEST(LayoutScriptText, DefinesWhatTheRecipeDefines) {
  DrawnLayout layout;
  layout.map.things.push_back({.editor_number = 1});
  layout.map.things.push_back({.editor_number = 2});
  layout.defines = {{"DOORS", 3}};
  layout.arrays = {{"door_x", {-5, 7}}, {"nothing", {}}};
  const std::string text = layout_script_text({"toy", 9, 1, 0, {{"side", 512}}}, layout);
  for (const char* line :
       {"#define LAYOUT_SEED 9\n", "#define LAYOUT_PLAYERS 2\n", "#define PARAM_SIDE 512\n",
        "#define DOORS 3\n", "int door_x[2] = {-5, 7};\n", "int nothing[1] = {0};\n"})
    EXPECT_THAT(text, HasSubstr(line));
}

}  // namespace recipes_test
}  // namespace comrad::scenarios
