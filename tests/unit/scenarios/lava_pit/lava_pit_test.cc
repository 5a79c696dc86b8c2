// Lava Pit: bridges and plates, lava, progress, milestones and endings; layouts; the scripted team.
#include <cmath>

#include "scenarios/lava_pit/layout.h"
#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace lava_pit_test {

namespace pit = scenarios::lava_pit;

struct Rectangle {
  double left = 1e9, right = -1e9, bottom = 1e9, top = -1e9;
  Place centre() const { return {(left + right) / 2, (bottom + top) / 2}; }
};

/// Outer edges of the sector with this tag.
Rectangle outline(PlayedScenario& stage, int32_t tag) {
  Rectangle box;
  const doom::Level& level = stage.world().level();
  for (const doom::Linedef& line : level.linedefs)
    for (const std::optional<uint32_t> side : {std::optional<uint32_t>(line.front), line.back}) {
      if (!side || level.sectors[level.sidedefs[*side].sector_index].tag != tag) continue;
      for (const uint32_t v : {line.start, line.end}) {
        const double x = doom::to_double(level.vertices[v].x), y = doom::to_double(level.vertices[v].y);
        box.left = std::min(box.left, x), box.right = std::max(box.right, x);
        box.bottom = std::min(box.bottom, y), box.top = std::max(box.top, y);
      }
    }
  return box;
}
const doom::Sector& sector(PlayedScenario& stage, int32_t tag) {
  for (const doom::Sector& s : stage.world().sectors())
    if (s.tag == tag) return s;
  ADD_FAILURE() << "no sector has tag " << tag;
  return stage.world().sectors()[0];
}
double bridge_floor(PlayedScenario& stage, int i) {
  return doom::to_double(sector(stage, pit::kBridgeTag + i).floor_height);
}
Place active_plate(PlayedScenario& stage, int32_t first_tag, int bridge) {
  for (int v = 0; v < pit::kCandidatesMax; ++v) {
    const int32_t tag = first_tag + pit::kCandidatesMax * bridge + v;
    for (const doom::Sector& s : stage.world().sectors())
      if (s.tag == tag && s.floor_texture == "FLAT23") return outline(stage, tag).centre();
  }
  ADD_FAILURE() << "no plate shines";
  return {};
}
void put(PlayedScenario& stage, int agent, Place p) { stage.put(agent, p.x, p.y); }

TEST(LavaPit, APlateRaisesItsBridgeInSevenTicsAndLeavingSinksItInFour) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  EXPECT_EQ(bridge_floor(stage, 1), -80);
  put(stage, 0, active_plate(stage, pit::kGreenTag, 1));
  stage.run(9);
  EXPECT_EQ(bridge_floor(stage, 1), 0);
  EXPECT_EQ(sector(stage, pit::kBridgeTag + 1).floor_texture, "FLAT5_4");
  EXPECT_EQ(stage.user(13), 2);
  put(stage, 0, outline(stage, pit::kPlatformTag + 2).centre());
  stage.run(6);
  EXPECT_EQ(bridge_floor(stage, 1), -80);
  EXPECT_EQ(sector(stage, pit::kBridgeTag + 1).floor_texture, "LAVA1");
  put(stage, 1, active_plate(stage, pit::kRedTag, 1));
  stage.run(9);
  EXPECT_EQ(bridge_floor(stage, 1), 0) << "the red plate does the same";
}

TEST(LavaPit, ABridgeTurnsRoundAtOnceAndBurnsOnlyBelowThePlatforms) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  put(stage, 0, active_plate(stage, pit::kGreenTag, 1));
  stage.run(4);
  const double half_way = bridge_floor(stage, 1);
  EXPECT_GT(half_way, -80);
  EXPECT_LT(half_way, 0);
  EXPECT_GT(sector(stage, pit::kBridgeTag + 1).damage_amount, 0);
  put(stage, 0, outline(stage, pit::kPlatformTag + 0).centre());
  stage.run(3);
  EXPECT_LT(bridge_floor(stage, 1), half_way);
  put(stage, 0, active_plate(stage, pit::kGreenTag, 1));
  stage.run(9);
  EXPECT_EQ(bridge_floor(stage, 1), 0);
  EXPECT_EQ(sector(stage, pit::kBridgeTag + 1).damage_amount, 0);
}

TEST(LavaPit, TheFirstBridgeStaysUpFor105Tics) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  put(stage, 0, active_plate(stage, pit::kGreenTag, 0));
  stage.run(10);
  put(stage, 0, outline(stage, pit::kPlatformTag + 0).centre());
  stage.run(100);
  EXPECT_EQ(bridge_floor(stage, 0), 0);
  stage.run(15);
  EXPECT_EQ(bridge_floor(stage, 0), -80);
}

TEST(LavaPit, LavaKillsAndEndsTheRunWithItsPenalties) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  const double before = stage.returns[0];
  const Rectangle sea = outline(stage, pit::kLavaTag);
  put(stage, 1, {sea.left + 100, sea.bottom + 100});
  const int tics = stage.run(20);
  EXPECT_LE(tics, 4);
  ASSERT_TRUE(stage.environment.last_step().terminated);
  EXPECT_EQ(stage.environment.summary().score, 0);
  // Each agent's half of: -0.002 a decision, -1.25, -0.12 for each of the 11 platforms left.
  EXPECT_NEAR(stage.returns[0] - before, (-0.002 * tics - 1.25 - 0.12 * 11) / 2, 1e-4);
}

TEST(LavaPit, ProgressCountsThePlatformThatBothHaveReached) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  EXPECT_EQ(stage.user(11), 1) << "no reward for where they begin";
  EXPECT_NEAR(stage.returns[0], -0.002 * 4 / 2, 1e-6);
  put(stage, 0, outline(stage, pit::kPlatformTag + 3).centre());
  stage.run(2);
  EXPECT_EQ(stage.user(12), 4);
  EXPECT_EQ(stage.user(11), 1);
  put(stage, 1, active_plate(stage, pit::kGreenTag, 2));
  stage.run(2);
  EXPECT_EQ(stage.user(11), 3) << "a plate is part of its platform";
  EXPECT_EQ(stage.user(24), 2);
  EXPECT_GT(stage.returns[0], 0.74) << "half of 2 x 0.75";
}

TEST(LavaPit, MilestonesArePaidOnceForEachFrontier) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  put(stage, 0, active_plate(stage, pit::kGreenTag, 0));
  stage.run(10);
  EXPECT_EQ(stage.user(25), 50);
  EXPECT_EQ(stage.user(20), 1);
  EXPECT_EQ(stage.user(23), 1);
  put(stage, 1, outline(stage, pit::kBridgeTag + 0).centre());
  stage.run(2);
  EXPECT_EQ(stage.user(25), 150);
  put(stage, 1, active_plate(stage, pit::kRedTag, 0));
  stage.run(2);
  EXPECT_EQ(stage.user(25), 250);
  stage.run(64);
  EXPECT_EQ(stage.user(26), 0);
  stage.run(8);
  EXPECT_EQ(stage.user(26), 2) << "two decisions' worth of stalling";
}

TEST(LavaPit, TheGoalEndsTheRunWithSuccess) {
  PlayedScenario stage("lava_pit");
  stage.run(4);
  const Place goal = outline(stage, pit::kPlatformTag + 11).centre();
  put(stage, 0, goal);
  put(stage, 1, {goal.x, goal.y + 60});
  EXPECT_LE(stage.run(10), 4);
  ASSERT_TRUE(stage.environment.last_step().terminated);
  EXPECT_EQ(stage.environment.summary().score, 11);
  EXPECT_NEAR(stage.returns[0], (11 * 0.75 + 2) / 2, 0.05);
}

TEST(LavaPit, ARunLeapDoesNotCrossTheNarrowestGap) {
  // Forward and sideways at once, a jump at the edge, every approach angle; the shared platforms are
  // 240 apart.
  PlayedScenario stage("lava_pit", {.parameters = {{"first_gap", "240"}, {"platforms", "3"}}});
  stage.run(4);
  const Rectangle near = outline(stage, pit::kPlatformTag), far = outline(stage, pit::kPlatformTag + 1);
  double best = -1e9;
  for (const double lead : {20.0, 26.0, 32.0, 38.0, 44.0, 50.0})
    for (const double angle : {0.0, 45.0}) {
      PlayedScenario leap("lava_pit", {.parameters = {{"first_gap", "240"}, {"platforms", "3"}}});
      leap.run(4);
      leap.put(0, near.left + 40, near.bottom + 60);
      leap.look(0, angle);
      leap.buttons[0].forward = true;
      leap.buttons[0].right = angle > 0;
      while (!leap.over() && place_of(leap.body(0)).x < near.right - lead + 16) leap.run(1);
      leap.buttons[0].jump = true;
      double furthest = -1e9;
      while (!leap.over()) {
        leap.run(1);
        furthest = std::max(furthest, place_of(leap.body(0)).x);
      }
      best = std::max(best, furthest);
      EXPECT_LT(leap.user(15), 2) << "lead " << lead << ", angle " << angle;
    }
  EXPECT_LT(best, far.left) << "not even the body's middle gets over the far edge";
}

TEST(LavaPitLayout, ThirtySeedsOfEveryProfileGiveMaps) {
  const std::vector<std::vector<std::pair<std::string, std::string>>> profiles = {{},
                                                                                  {{"gap_min", "240"},
                                                                                   {"gap_max", "300"},
                                                                                   {"width_min", "400"},
                                                                                   {"width_max", "520"},
                                                                                   {"platforms", "10"}},
                                                                                  {{"gap_min", "300"},
                                                                                   {"gap_max", "420"},
                                                                                   {"width_min", "320"},
                                                                                   {"width_max", "420"},
                                                                                   {"depth_min", "220"},
                                                                                   {"depth_max", "300"},
                                                                                   {"jitter", "72"},
                                                                                   {"lateral", "440"},
                                                                                   {"amplitude", "320"},
                                                                                   {"waves", "2"},
                                                                                   {"platforms", "14"}}};
  for (const auto& profile : profiles)
    for (uint64_t seed = 0; seed < 30; ++seed) {
      const auto layout = scenarios::generate_layout("lava_pit", {.seed = seed, .parameters = profile});
      ASSERT_TRUE(layout) << layout.error().message;
      EXPECT_TRUE(layout->warnings.empty());
    }
}

TEST(LavaPitOracle, ClearsEveryBridge) { EXPECT_EQ(oracle_mean("lava_pit", 4), 11); }

}  // namespace lava_pit_test
}  // namespace comrad::sim
