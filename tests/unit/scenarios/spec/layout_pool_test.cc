#include "scenarios/spec/layout_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>

#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/wad_maps.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/vizdoom_room.h"

namespace comrad::scenarios {
namespace layout_pool_test {

using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

class LayoutPool : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("comrad_pool_" + std::to_string(getpid()));
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string folder(const char* name) const { return (folder_ / name).string(); }
  fs::path folder_;
};

/// The contents of a pool's files, read from them rather than from the registry.
std::vector<uint64_t> contents_of(const std::string& folder) {
  std::vector<uint64_t> contents;
  const auto pool = read_pool(folder);
  EXPECT_TRUE(pool) << pool.error().message;
  for (const PoolEntry& entry : *pool) {
    const auto wad = wad::WadFile::open(entry.filename);
    const auto content = wad ? layout_content(*wad) : Expected<uint64_t>(wad.error());
    EXPECT_TRUE(content) << content.error().message;
    EXPECT_EQ(*content, entry.map_hash) << entry.id;
    contents.push_back(*content);
  }
  return contents;
}

TEST_F(LayoutPool, TrainingAndEvaluationShareNoMapWhateverTheParametersAre) {
  // Recipes with few maps, drawn in ways that meet the same maps from other seeds, formats and team sizes.
  using Pairs = std::vector<std::pair<std::string, std::string>>;
  std::map<uint64_t, PoolKind> pool_of;
  int part = 0, meetings = 0;
  for (const PoolKind kind : {PoolKind::kTrain, PoolKind::kEval})
    for (const MapFormat format : {MapFormat::kUdmf, MapFormat::kHexen})
      for (const Pairs& parameters : {Pairs{}, Pairs{{"variety", "0"}}, Pairs{{"damage", "35"}}}) {
        SCOPED_TRACE(testing::Message() << "pool " << part);
        PoolRequest request{.kind = kind, .count = kind == PoolKind::kTrain ? 4 : 1};
        request.layout = {.parameters = parameters, .format = format};
        const std::string where = folder(("part" + std::to_string(part++)).c_str());
        const auto made = make_pool("lava_maze", request, where);
        if (!made) {  // none of its few maps belongs to this pool
          EXPECT_THAT(made.error().message, HasSubstr("draws gave only"));
          EXPECT_FALSE(fs::exists(fs::path(where) / kPoolRegistryName));
          EXPECT_TRUE(fs::is_empty(where));
          continue;
        }
        for (const uint64_t content : contents_of(where)) {
          const auto [known, is_new] = pool_of.emplace(content, kind);
          meetings += !is_new;
          EXPECT_EQ(known->second, kind);
        }
      }
  EXPECT_GT(meetings, 3) << "these pools were to meet the same maps";
}

TEST_F(LayoutPool, HeldOutMapsAreInEveryEvaluationPoolAndInNoneForTraining) {
  PoolRequest request{.kind = PoolKind::kEval, .count = 6, .vary = false};
  const auto held_out = make_pool("stag_hunt_arena", request, folder("held_out"));
  ASSERT_TRUE(held_out) << held_out.error().message;
  const auto split = ContentSplit::of("stag_hunt_arena");
  ASSERT_TRUE(split);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ((*held_out)[i].info.seed, kHeldOutSeeds[i]);
    EXPECT_TRUE(split->is_for_evaluation((*held_out)[i].map_hash));
  }
  // Where all seeds give the held-out map there is nothing to train on.
  const auto none =
      make_pool("lava_maze", {.kind = PoolKind::kTrain, .count = 1, .vary = false}, folder("x"));
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message,
              AllOf(HasSubstr("300 draws gave only 0 distinct ones (300 draws belong to evaluation"),
                    HasSubstr("--no-vary"), HasSubstr("--set NAME=VALUE: side"), HasSubstr("--count")));
}

TEST_F(LayoutPool, AMapIsInAPoolOnceAndAnExhaustedRecipeReportsHowManyThereAre) {
  PoolRequest request{.kind = PoolKind::kTrain, .count = 40};
  request.layout.parameters = {{"variety", "0"}};
  PoolTally tally;
  const auto made = make_pool("lava_maze", request, folder("train"), nullptr, &tally);
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(made.error().message,
              AllOf(HasSubstr("40 layouts for training were requested"), HasSubstr("repetitions"),
                    HasSubstr("leave out some of the parameters that were set")));
  EXPECT_GT(tally.repeated, 100);
  const auto maps = count_distinct_maps("lava_maze", request, 300);
  ASSERT_TRUE(maps) << maps.error().message;
  EXPECT_EQ(maps->kind, DistinctMaps::Kind::kAll);
  EXPECT_EQ(maps->count, 6);
  EXPECT_FALSE(count_distinct_maps("lava_maze", request, 1));
}

TEST_F(LayoutPool, WhatIsSetStaysAsItIsWhereAxesAreDrawn) {
  PoolRequest request{.kind = PoolKind::kTrain, .count = 1};
  request.layout.parameters = {{"initial", "3"}, {"variety", "0"}, {"damage", "11"}};
  const auto made = make_pool("lava_maze", request, folder("train"));
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ((*made)[0].info.parameters.at("initial"), 3);
  EXPECT_FALSE((*made)[0].info.parameters.contains("variety")) << "0, and then it is not written";
  ASSERT_EQ((*made)[0].axis_choices.size(), 1u);
  EXPECT_EQ((*made)[0].axis_choices[0].first, "maximum");
}

TEST_F(LayoutPool, CheckFindsMapsForEvaluationByTheirContent) {
  // A grid belongs to no split: what is for evaluation in it is found by its content.
  const auto split = ContentSplit::of("stag_hunt_arena");
  ASSERT_TRUE(split);
  GridRequest request{.axes = {{"seed", {}}}};
  for (int64_t seed = 0; seed < 40; ++seed) request.axes[0].options.push_back({{"seed", seed}});
  const auto all = make_grid_pool("stag_hunt_arena", request, folder("grid"));
  ASSERT_TRUE(all);
  std::string first;
  for (const PoolEntry& entry : *all)
    if (first.empty() && split->is_for_evaluation(entry.map_hash)) first = entry.id;
  ASSERT_FALSE(first.empty());
  EXPECT_TRUE(check_pool(folder("grid"), {.scenario = "stag_hunt_arena"}));
  for (const bool with_registry : {true, false}) {
    if (!with_registry) fs::remove(folder_ / "grid" / kPoolRegistryName);
    const auto refused = check_pool(folder("grid"), {.for_training = true});
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message,
                AllOf(HasSubstr(first), HasSubstr("is for evaluation"), HasSubstr("--for train")));
  }
  request.for_training = true;
  const auto part = make_grid_pool("stag_hunt_arena", request, folder("part"));
  ASSERT_TRUE(part);
  EXPECT_LT(part->size(), all->size());
  EXPECT_TRUE(check_pool(folder("part"), {.for_training = true}));
}

TEST_F(LayoutPool, CheckFindsOneMapTwice) {
  // As pools were before maps were compared by content: two seeds, one map.
  ASSERT_TRUE(
      make_grid_pool("lava_maze", {.axes = {{"seed", {{{"seed", 1}}, {{"seed", 2}}}}}}, folder("pool")));
  EXPECT_TRUE(check_pool(folder("pool"), {})) << "a grid may hold a map twice";
  std::string registry = *read_scenario_file((folder_ / "pool" / kPoolRegistryName).string());
  for (std::size_t at = 0; (at = registry.find("\"split\": \"\"", at)) != std::string::npos; ++at)
    registry.replace(at, 11, "\"split\": \"train\"");
  std::ofstream(folder_ / "pool" / kPoolRegistryName) << registry;
  EXPECT_THAT(check_pool(folder("pool"), {.for_training = true}).error().message,
              HasSubstr("drawn by an older version"))
      << "its map is the held-out one";
  const auto twice = check_pool(folder("pool"), {});
  ASSERT_FALSE(twice);
  EXPECT_THAT(twice.error().message,
              AllOf(HasSubstr("lava_maze_0001"), HasSubstr("the same map as lava_maze_0000")));
}

TEST_F(LayoutPool, FilesRegistryAndHashesAgree) {
  const auto made =
      make_pool("foraging_commons", {.kind = PoolKind::kTrain, .count = 12, .vary = true}, folder("train"));
  ASSERT_TRUE(made) << made.error().message;
  const auto pool = read_pool(folder("train"));
  ASSERT_TRUE(pool) << pool.error().message;
  ASSERT_EQ(pool->size(), 12u);
  std::set<uint64_t> hashes;
  for (const PoolEntry& entry : *pool) {
    EXPECT_EQ(fs::path(entry.filename).stem(), entry.id);
    const auto bytes = read_scenario_file(entry.filename);
    ASSERT_TRUE(bytes);
    EXPECT_EQ(doomgen::content_hash(*bytes), entry.content_hash);
    EXPECT_EQ(entry.axis_choices.size(), layout_recipe("foraging_commons")->axes.size());
    hashes.insert(entry.content_hash);
    // The registry suffices to draw the layout again.
    LayoutRequest again{.seed = entry.info.seed};
    for (const auto& [name, value] : entry.info.parameters)
      again.parameters.emplace_back(name, std::to_string(value));
    EXPECT_EQ(generate_layout("foraging_commons", again)->content_hash, entry.content_hash);
  }
  EXPECT_EQ(hashes.size(), 12u);
}

TEST_F(LayoutPool, WithoutRegistryAllWadsCountInTheOrderOfTheirNames) {
  fs::create_directories(folder("plain"));
  for (const char* name : {"b.wad", "a.wad", "notes.txt"}) std::ofstream(folder_ / "plain" / name) << "PWAD";
  const auto pool = read_pool(folder("plain"));
  ASSERT_TRUE(pool);
  ASSERT_EQ(pool->size(), 2u);
  EXPECT_EQ((*pool)[0].id, "a");
  EXPECT_EQ((*pool)[1].id, "b");
}

TEST_F(LayoutPool, BadPoolsSayWhatIsWrong) {
  EXPECT_FALSE(read_pool(folder("missing")));
  fs::create_directories(folder("empty"));
  EXPECT_THAT(read_pool(folder("empty")).error().message, HasSubstr("empty"));
  std::ofstream(folder_ / "empty" / kPoolRegistryName) << "[{\"id\": 3}]";
  EXPECT_THAT(read_pool(folder("empty")).error().message, HasSubstr("entry 0"));
  std::ofstream(folder_ / "empty" / kPoolRegistryName) << "{";
  EXPECT_THAT(read_pool(folder("empty")).error().message, HasSubstr("line 1, column 2"));
  EXPECT_THAT(make_pool("stag_hunt_arena", {.count = 0}, folder("x")).error().message,
              HasSubstr("1..100000"));
  EXPECT_THAT(make_pool("no_such", {.count = 1}, folder("x")).error().message, HasSubstr("no_such"));
}

TEST_F(LayoutPool, CheckReadsEveryFileAndGivesWhatARunReads) {
  ASSERT_TRUE(make_pool("foraging_commons", {.kind = PoolKind::kTrain, .count = 3}, folder("train")));
  const auto list =
      check_pool(folder("train"), {.scenario = "foraging_commons", .num_agents = 2, .for_training = true});
  ASSERT_TRUE(list) << list.error().message;
  ASSERT_EQ(list->layouts.size(), 3u);
  for (const LayoutEntry& layout : list->layouts) {
    EXPECT_TRUE(fs::path(layout.path).is_absolute());
    EXPECT_TRUE(fs::exists(layout.path));
  }
  EXPECT_TRUE(list->interestingness_graph.empty());
}

TEST_F(LayoutPool, EveryLayoutHasTheCeilingOfItsTeam) {
  ASSERT_TRUE(make_pool("platform_chain", {.kind = PoolKind::kEval, .count = 8}, folder("chain")));
  const auto pool = read_pool(folder("chain"));
  const auto list = check_pool(folder("chain"), {.scenario = "platform_chain", .num_agents = 2});
  ASSERT_TRUE(list) << list.error().message;
  std::set<double> ceilings;
  for (std::size_t i = 0; i < pool->size(); ++i) {
    const double last = static_cast<double>((*pool)[i].info.parameters.at("levels") - 1);
    EXPECT_EQ((*pool)[i].info.ceiling, (std::map<int, double>{{2, last}}));
    EXPECT_EQ(list->layouts[i].ceiling, last);
    ceilings.insert(last);
  }
  EXPECT_GT(ceilings.size(), 1u) << "eight layouts of one length";
  ASSERT_TRUE(make_pool("armory_siege", {.kind = PoolKind::kEval, .count = 1, .vary = false}, folder("d")));
  EXPECT_DOUBLE_EQ(check_pool(folder("d"), {.scenario = "armory_siege", .num_agents = 8})->layouts[0].ceiling,
                   962.345);
  EXPECT_DOUBLE_EQ(check_pool(folder("d"), {.scenario = "armory_siege"})->layouts[0].ceiling, 1123.47)
      << "of the scenario's default team where none is named";
  std::ofstream(folder_ / "d" / kPoolRegistryName)
      << R"([{"id": "a", "filename": "armory_siege_1009.wad", "ceiling": {"two": 1}}])";
  EXPECT_THAT(read_pool(folder("d")).error().message, AllOf(HasSubstr("entry 0"), HasSubstr("'ceiling'")));
}

TEST_F(LayoutPool, LayoutsThatGiveTooLittleAreLeftOut) {
  // The third option of the rate cannot feed two, and the second one not two whose hunger is 3.
  const auto pool = make_pool("foraging_commons", {.kind = PoolKind::kTrain, .count = 40}, folder("train"));
  ASSERT_TRUE(pool) << pool.error().message;
  EXPECT_EQ(pool->size(), 40u);
  std::set<int64_t> costs;
  for (const PoolEntry& entry : *pool) {
    EXPECT_TRUE(entry.info.ceiling.contains(2)) << entry.id;
    costs.insert(entry.info.parameters.at("harvest_cost"));
    EXPECT_TRUE(entry.info.parameters.at("harvest_cost") == 1 || entry.info.parameters.at("drain") < 3);
  }
  EXPECT_EQ(costs, (std::set<int64_t>{1, 2}));
  const auto maps = count_distinct_maps("foraging_commons", {}, 40);
  ASSERT_TRUE(maps) << maps.error().message;
  EXPECT_EQ(maps->draws, 40) << "options that are left out are no draws";
  const auto none =
      make_pool("foraging_commons", {.count = 3, .vary = false, .layout = {.parameters = {{"drain", "3"}}}},
                folder("none"));
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message, HasSubstr("cannot be solved by 2 agents"));

  std::vector<int64_t> left_out;
  const auto grid =
      make_grid_pool("foraging_commons",
                     {.axes = {{"drain", {{{"drain", 1}}, {{"drain", 3}}, {{"drain", 2}}}}},
                      .left_out = [&](int64_t place, const Error&) { left_out.push_back(place); }},
                     folder("grid"));
  ASSERT_TRUE(grid) << grid.error().message;
  EXPECT_EQ(left_out, std::vector<int64_t>{1});
  ASSERT_EQ(grid->size(), 2u);
  EXPECT_EQ((*grid)[1].id, "foraging_commons_0002") << "places keep their numbers";

  // A pool for two that four cannot live on.
  ASSERT_TRUE(
      make_pool("coop_health_gathering",
                {.count = 1, .vary = false, .layout = {.num_agents = 2, .parameters = {{"radius", "2400"}}}},
                folder("two")));
  EXPECT_TRUE(check_pool(folder("two"), {.scenario = "coop_health_gathering", .num_agents = 2}));
  const auto four = check_pool(folder("two"), {.scenario = "coop_health_gathering", .num_agents = 4});
  ASSERT_FALSE(four);
  EXPECT_THAT(four.error().message, HasSubstr("not enough for 4 agents"));
}

TEST_F(LayoutPool, CheckNamesTheLayoutThatIsWrong) {
  const auto error = [&](const char* name, const PoolUse& use) {
    const auto list = check_pool(folder(name), use);
    return list ? std::string("no error") : list.error().message;
  };
  ASSERT_TRUE(make_pool("foraging_commons", {.kind = PoolKind::kEval, .count = 2}, folder("eval")));
  EXPECT_EQ(error("eval", {.scenario = "foraging_commons"}), "no error");
  EXPECT_THAT(error("eval", {.for_training = true}),
              AllOf(HasSubstr("foraging_commons_"), HasSubstr("for evaluation"), HasSubstr("--pool train")));
  EXPECT_THAT(error("eval", {.scenario = "rhythm_sync"}),
              HasSubstr("a map of scenario foraging_commons, not of rhythm_sync"));
  EXPECT_THAT(error("eval", {.num_agents = 8}), HasSubstr("no start for player 5 of 8"));
  fs::remove(folder_ / "eval" / kPoolRegistryName);
  EXPECT_THAT(error("eval", {.for_training = true}), HasSubstr("for evaluation"))
      << "their contents tell it without a registry";

  ASSERT_TRUE(make_pool("foraging_commons", {.kind = PoolKind::kTrain, .count = 2}, folder("train")));
  const auto pool = read_pool(folder("train"));
  fs::copy_file((*pool)[0].filename, (*pool)[1].filename, fs::copy_options::overwrite_existing);
  EXPECT_THAT(error("train", {}), AllOf(HasSubstr((*pool)[1].id), HasSubstr("content_hash")));
  fs::remove((*pool)[1].filename);
  EXPECT_THAT(error("train", {}), AllOf(HasSubstr((*pool)[1].filename), HasSubstr("cannot be read")));
}

TEST_F(LayoutPool, PlatformChainComesWithItsTwelveStages) {
  const auto made = make_pool("platform_chain", {.kind = PoolKind::kCurriculum}, folder("stages"));
  ASSERT_TRUE(made) << made.error().message;
  const auto pool = read_pool(folder("stages"));
  ASSERT_TRUE(pool);
  ASSERT_EQ(pool->size(), 12u);
  // The published table: levels, step, spacing, panels, tether, lava, seed; 0: the generator's default.
  constexpr int64_t kStages[12][7] = {
      {0, 10, 168, 2, 300, 20, 42},  {0, 10, 176, 4, 285, 30, 43},   {0, 11, 180, 6, 270, 40, 44},
      {0, 12, 184, 8, 250, 50, 45},  {24, 10, 172, 4, 290, 25, 42},  {28, 11, 176, 6, 275, 35, 43},
      {32, 12, 180, 6, 260, 45, 44}, {40, 11, 176, 6, 265, 35, 42},  {48, 12, 180, 8, 250, 50, 42},
      {48, 12, 182, 8, 240, 50, 43}, {56, 12, 184, 10, 230, 60, 44}, {60, 13, 188, 12, 220, 70, 45}};
  for (std::size_t i = 0; i < 12; ++i) {
    const PoolEntry& stage = (*pool)[i];
    SCOPED_TRACE(stage.id);
    const auto& values = stage.info.parameters;
    if (kStages[i][0] > 0) {
      EXPECT_EQ(values.at("levels"), kStages[i][0]);
    }
    EXPECT_EQ(values.at("step"), kStages[i][1]);
    EXPECT_EQ(values.at("spacing"), kStages[i][2]);
    EXPECT_EQ(values.at("panels"), kStages[i][3]);
    EXPECT_EQ(values.at("tether"), kStages[i][4]);
    EXPECT_EQ(values.at("lava"), kStages[i][5]);
    EXPECT_EQ(stage.info.seed, static_cast<uint64_t>(kStages[i][6]));
    EXPECT_EQ(stage.metric_scale, static_cast<double>(values.at("levels") - 1));
    EXPECT_FALSE(stage.stage.empty());
    EXPECT_EQ(stage.split, "train");
  }
  const auto list =
      check_pool(folder("stages"), {.scenario = "platform_chain", .num_agents = 2, .for_training = true});
  ASSERT_TRUE(list) << list.error().message;
  EXPECT_EQ(list->layouts[7].metric_scale, 39.0);
  EXPECT_TRUE(fs::exists(list->interestingness_graph));
  EXPECT_THAT(make_pool("rhythm_sync", {.kind = PoolKind::kCurriculum}, folder("none")).error().message,
              HasSubstr("these do: lava_maze, platform_chain, stealth_labyrinth"));
}

TEST_F(LayoutPool, StealthLabyrinthsStagesLeadToItsOwnMap) {
  const auto made = make_pool("stealth_labyrinth", {.kind = PoolKind::kCurriculum}, folder("stages"));
  ASSERT_TRUE(made) << made.error().message;
  ASSERT_EQ(made->size(), 9u);
  const auto own = generate_layout("stealth_labyrinth", {.seed = 42});
  ASSERT_TRUE(own);
  EXPECT_EQ(made->back().map_hash, own->map_hash);
  EXPECT_EQ(made->back().content_hash, own->content_hash);
  // No stage is easier than the one before in any respect.
  for (std::size_t i = 1; i < made->size(); ++i) {
    const auto &before = (*made)[i - 1].info.parameters, &now = (*made)[i].info.parameters;
    SCOPED_TRACE((*made)[i].id);
    for (const char* harder : {"rooms", "strength", "first_health", "room_length"})
      EXPECT_GE(now.at(harder), before.at(harder)) << harder;
    EXPECT_LE(now.at("first_margin"), before.at("first_margin"));
    const auto start_at = [](const ParameterValues& of) {  // a map that has its default omits it
      return of.contains("start_at") ? of.at("start_at") : 0;
    };
    EXPECT_LE(start_at(now), start_at(before));
  }
  EXPECT_TRUE(
      check_pool(folder("stages"), {.scenario = "stealth_labyrinth", .num_agents = 2, .for_training = true}));
}

TEST_F(LayoutPool, LavaMazesStagesShowTheWayLessAndLess) {
  const auto made = make_pool("lava_maze", {.kind = PoolKind::kCurriculum}, folder("stages"));
  ASSERT_TRUE(made) << made.error().message;
  // The last one is the default map, which is held out, but for lava that kills at once.
  const auto own = generate_layout("lava_maze", {.seed = 42});
  ASSERT_TRUE(own);
  ParameterValues parameters = own->info.parameters;
  parameters["damage"] = 100;
  EXPECT_EQ(made->back().info.parameters, parameters);
  int64_t guide = 100;
  for (const PoolEntry& stage : *made) {
    const auto found = stage.info.parameters.find("guide");
    const int64_t now = found == stage.info.parameters.end() ? 0 : found->second;
    EXPECT_LE(now, guide) << stage.id;
    guide = now;
  }
  EXPECT_EQ(guide, 0);
  const auto list =
      check_pool(folder("stages"), {.scenario = "lava_maze", .num_agents = 2, .for_training = true});
  ASSERT_TRUE(list) << list.error().message;
  EXPECT_EQ(list->layouts.front().metric_scale, 1.0);
  EXPECT_EQ(list->layouts.back().metric_scale, 6.0);
}

TEST_F(LayoutPool, AGridIsTheFullProductWithItsLastAxisFastest) {
  const GridRequest request{.axes = {{"initial", {{{"initial", 3}}, {{"initial", 5}}}},
                                     {"damage", {{{"damage", 10}}, {{"damage", 20}}}},
                                     {"seed", {{{"seed", 0}}, {{"seed", 1}}, {{"seed", 2}}}}},
                            .layout = {.parameters = {{"side", "6"}}}};
  const auto made = make_grid_pool("lava_maze", request, folder("grid"));
  ASSERT_TRUE(made) << made.error().message;
  const auto pool = read_pool(folder("grid"));
  ASSERT_TRUE(pool);
  ASSERT_EQ(pool->size(), 12u);
  for (int place = 0; place < 12; ++place) {
    const PoolEntry& entry = (*pool)[static_cast<std::size_t>(place)];
    EXPECT_EQ(entry.id, std::string("lava_maze_00") + (place < 10 ? "0" : "") + std::to_string(place));
    EXPECT_EQ(entry.info.parameters.at("initial"), place < 6 ? 3 : 5);
    EXPECT_EQ(entry.info.parameters.at("damage"), place % 6 < 3 ? 10 : 20);
    EXPECT_EQ(entry.info.parameters.at("side"), 6);
    EXPECT_EQ(entry.info.seed, static_cast<uint64_t>(place % 3));
    EXPECT_TRUE(entry.split.empty());
  }
  const auto part =
      make_grid_pool("lava_maze", {.axes = request.axes, .start = 10, .limit = 9}, folder("part"));
  ASSERT_TRUE(part);
  EXPECT_EQ(part->size(), 2u);
  EXPECT_EQ((*part)[0].id, "lava_maze_0010");
  EXPECT_THAT(make_grid_pool("lava_maze", {.axes = request.axes, .start = 12}, folder("x")).error().message,
              HasSubstr("has 12 layouts"));
  EXPECT_THAT(
      make_grid_pool("lava_maze", {.axes = {request.axes[0], request.axes[0]}}, folder("x")).error().message,
      HasSubstr("two axes of the grid set initial"));
  // The recipe's own axes: the product that was published.
  const auto own = make_grid_pool("lava_pit", {.start = 485}, folder("own"));
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(own->size(), 1u) << "486 layouts";
}

TEST_F(LayoutPool, EveryMapOfAWadIsALayoutWithAllThatIsNoOtherMap) {
  const test::ScratchFolder scratch;
  const std::string path = scratch.write("many.wad", test::room_wad({"MAP01", "MAP07", "E1M1"}, 2));
  const auto pool = split_wad(path, folder("maps"));
  ASSERT_TRUE(pool) << pool.error().message;
  ASSERT_EQ(pool->size(), 3u);
  const auto list = check_pool(folder("maps"), {.num_agents = 2, .for_training = true});
  ASSERT_TRUE(list) << list.error().message;
  std::vector<std::string> ids;
  for (const LayoutEntry& layout : list->layouts) {
    ids.push_back(layout.id);
    const auto wad = wad::WadFile::open(layout.path);
    ASSERT_TRUE(wad) << wad.error().message;
    EXPECT_EQ("many_" + wad->map_names().at(0), layout.id);
    EXPECT_EQ(wad->map_names().size(), 1u);
  }
  EXPECT_THAT(ids, testing::ElementsAre("many_MAP01", "many_MAP07", "many_E1M1"));

  // Of an IWAD the art stays behind; of another WAD it comes along.
  for (const bool is_iwad : {false, true}) {
    doomgen::WadWriter wad;
    ASSERT_TRUE(wad.add("PLAYPAL", "colours"));
    ASSERT_TRUE(wad.add_udmf_map("MAP01", "first"));
    ASSERT_TRUE(wad.add("MAPINFO", "map MAP02"));
    ASSERT_TRUE(wad.add_udmf_map("MAP02", "second"));
    std::string bytes = *wad.bytes();
    if (is_iwad) bytes[0] = 'I';
    const auto split = split_wad(scratch.write("art.wad", bytes), folder("art"));
    ASSERT_TRUE(split) << split.error().message;
    const auto second = wad::WadFile::open(folder("art") + "/art_MAP02.wad");
    ASSERT_TRUE(second) << second.error().message;
    EXPECT_EQ(second->find("PLAYPAL").has_value(), !is_iwad);
    EXPECT_TRUE(second->find("MAPINFO"));
    EXPECT_EQ(second->text(second->find("TEXTMAP").value()), "second");
  }
  EXPECT_THAT(
      split_wad(scratch.write("none.wad", *doomgen::WadWriter().bytes()), folder("none")).error().message,
      HasSubstr("there is no map in it"));
}

}  // namespace layout_pool_test
}  // namespace comrad::scenarios
