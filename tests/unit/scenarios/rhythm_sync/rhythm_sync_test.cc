// Rhythm Sync: switches, windows and doors on the default map, measurements, rewards, endings, the
// scripted pair.
#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>

#include "sim_workers/oracle/oracle.h"
#include "tests/support/scenario_stage.h"

namespace comrad::sim {
namespace rhythm_sync_test {

constexpr const char* kScenario = "rhythm_sync";
constexpr int kStage = 24, kCompleted = 25, kType = 26, kPendingA = 27, kFailed = 29, kFinished = 30,
              kCueOwner = 31, kStages = 32, kSwitchX = 33, kCueA = 37, kCueB = 38, kInZoneA = 47,
              kZonesA = 51, kPressesA = 53;

struct Game : test::ScenarioGame {
  explicit Game(uint64_t seed = 1, const test::Parameters& parameters = {},
                const std::string& scenario = kScenario)
      : ScenarioGame(scenario, seed, parameters) {
    decide();
  }
  int switch_x(int lane) const { return user(kSwitchX + 2 * lane); }
  int switch_y(int lane) const { return user(kSwitchX + 2 * lane + 1); }
  void stand_at_switches() {
    for (int lane = 0; lane < 2; ++lane) put(lane, switch_x(lane) - 40, switch_y(lane));
    decide();
  }
  void tap(int lane) {
    press(static_cast<std::size_t>(lane)).use = true;
    decide();
    release();
  }
  void tap_both() {
    press(0).use = press(1).use = true;
    decide();
    release();
    decide();
  }
  doom::Fixed ceiling(int tag) {
    for (const doom::Sector& sector : world().sectors())
      if (sector.tag == tag) return sector.ceiling_height;
    return -1;
  }
};

TEST(RhythmSync, SwitchesLieWithinTheLimitsAndNearTheirBaseAtFirst) {
  for (uint64_t seed = 0; seed < 5; ++seed) {
    Game game(seed);
    std::set<int> intro, later;
    for (int stage = 1; stage <= 20; ++stage) {
      ASSERT_EQ(game.user(kStage), stage);
      for (int lane = 0; lane < 2; ++lane) {
        const int dx = game.switch_x(lane) - 512 * stage, dy = game.switch_y(lane) - (lane == 0 ? 128 : -128);
        EXPECT_LE(std::abs(dx), 208);
        EXPECT_LE(std::abs(dy), 74);
        if (lane == 0) (stage <= 8 ? intro : later).insert(dx);
      }
      game.stand_at_switches();
      game.tap_both();
    }
    EXPECT_LE(*intro.rbegin() - *intro.begin(), 52) << "a base and 12.5% of the limits";
    EXPECT_GT(*later.rbegin() - *later.begin(), 104) << "fresh draws";
  }
}

TEST(RhythmSync, PressingTogetherOpensTheDoorsOfBothLanes) {
  Game game;
  EXPECT_EQ(game.count("BlueTorch"), 20);
  EXPECT_EQ(game.count("GreenTorch"), 20);
  EXPECT_EQ(game.ceiling(1101), 0);
  game.stand_at_switches();
  EXPECT_EQ(game.user(kInZoneA), 1);
  game.press(0).use = game.press(1).use = true;
  game.decide();
  EXPECT_EQ(game.user(kCompleted), 1);
  EXPECT_EQ(game.user(kStage), 2);
  EXPECT_NEAR(game.reward(0), 0.5 - 0.001, 0.01) << "1 / N for a stage";
  game.decide(20);
  EXPECT_EQ(game.ceiling(1101), doom::to_fixed(124));
  EXPECT_EQ(game.ceiling(2101), doom::to_fixed(124));
  EXPECT_EQ(game.ceiling(1102), 0);
  EXPECT_EQ(game.count("RedTorch"), 1) << "of who pressed first";
}

TEST(RhythmSync, APressOutsideTheZoneHasNoEffect) {
  Game game;
  game.tap(0);
  game.tap(1);
  EXPECT_EQ(game.user(kPendingA) + game.user(kPressesA), 0);
  game.put(0, game.switch_x(0) - 65, game.switch_y(0));
  game.decide();
  game.tap(0);
  EXPECT_EQ(game.user(kPendingA), 0);
  game.put(0, game.switch_x(0) - 64, game.switch_y(0));
  game.decide();
  game.tap(0);
  EXPECT_EQ(game.user(kPendingA), 1);
}

TEST(RhythmSync, AFurtherPressBeginsTheWindowAnewInTheReferenceVariantAlone) {
  for (const bool is_reference : {false, true}) {
    Game game(1, {}, is_reference ? "rhythm_sync@reference" : kScenario);
    game.stand_at_switches();
    game.tap(0);
    game.decide(2);
    game.tap(0);  // 12 tics later
    game.decide(2);
    EXPECT_EQ(game.over(), !is_reference) << "17 tics after the first press";
  }
}

TEST(RhythmSync, ALonePressFailsWhenItsWindowEnds) {
  Game game;
  game.stand_at_switches();
  game.tap(0);  // pressed at the first tic of four
  EXPECT_EQ(game.user(kPendingA), 1);
  game.decide(3);
  EXPECT_FALSE(game.over()) << "16 tics";
  game.decide(2);
  ASSERT_TRUE(game.over());
  EXPECT_EQ(game.user(kFailed), 1);
  EXPECT_TRUE(game.env.last_step().terminated);
  EXPECT_FLOAT_EQ(game.env.summary().score, 0.0f);
  EXPECT_LT(game.reward(1), -0.4f) << "-1 / N";
}

TEST(RhythmSync, APartnerWithinTheWindowCompletesTheStage) {
  Game game;
  game.stand_at_switches();
  game.tap(0);
  game.decide(2);
  game.tap(1);  // 12 tics later
  EXPECT_EQ(game.user(kCompleted), 1);
  EXPECT_EQ(game.user(kPendingA), 0);
}

TEST(RhythmSync, PressingAgainDoesNotHoldTheWindowOpen) {
  Game game;
  game.stand_at_switches();
  for (int i = 0; i < 4 && !game.over(); ++i) {
    game.tap(0);
    game.decide();
  }
  ASSERT_TRUE(game.over());
  EXPECT_EQ(game.user(kFailed), 1);
}

TEST(RhythmSync, TheWindowShrinksToItsFloor) {
  Game game;
  for (int stage = 1; stage <= 9; ++stage) {
    game.stand_at_switches();
    game.tap_both();
  }
  ASSERT_EQ(game.user(kCompleted), 9);
  game.stand_at_switches();
  game.tap(0);
  game.decide(2);  // 12 tics after the press; 8 are allowed
  EXPECT_TRUE(game.over());
}

TEST(RhythmSync, TheBeatIsForBothThenForOne) {
  Game game;
  int seen_by_both = 0;
  for (int i = 0; i < 60; ++i) {
    game.decide();
    EXPECT_EQ(game.user(kCueA), game.user(kCueB));
    seen_by_both += game.user(kCueA);
  }
  EXPECT_GE(seen_by_both, 4);
  EXPECT_EQ(game.user(kCueOwner), -1);
  for (int stage = 1; stage <= 14; ++stage) {
    EXPECT_EQ(game.user(kType), stage <= 8 ? 0 : 1);
    game.stand_at_switches();
    game.tap_both();
  }
  std::set<int> owners;
  for (int stage = 15; stage <= 18; ++stage) {
    EXPECT_EQ(game.user(kType), 2);
    owners.insert(game.user(kCueOwner));
    game.stand_at_switches();
    game.tap_both();
  }
  EXPECT_EQ(owners, (std::set<int>{0, 1})) << "in turn";
}

TEST(RhythmSync, TwentyStagesFinishWithTheScoreOfOne) {
  Game game;
  for (int stage = 1; stage < 20; ++stage) {
    game.stand_at_switches();
    game.tap_both();
  }
  game.stand_at_switches();
  game.press(0).use = game.press(1).use = true;
  game.decide();
  ASSERT_TRUE(game.over());
  EXPECT_EQ(game.user(kFinished), 1);
  EXPECT_TRUE(game.env.last_step().terminated);
  EXPECT_FLOAT_EQ(game.env.summary().score, 1.0f);
  EXPECT_NEAR(game.reward(0), 0.5 + 0.5 - 0.001, 0.01);
}

TEST(RhythmSync, ComingNearerPaysOnceAndEnteringTheZonePays) {
  Game game;
  const double far = game.user(45);
  game.put(0, game.switch_x(0) - 100, game.switch_y(0));
  game.decide();
  EXPECT_NEAR(game.reward(0), 0.0005 * std::min(128.0, far - 100) - 0.001, 1e-4);
  game.put(0, game.switch_x(0) - 200, game.switch_y(0));
  game.decide();
  EXPECT_NEAR(game.reward(0), -0.001, 1e-6) << "going away costs nothing";
  game.put(0, game.switch_x(0) - 100, game.switch_y(0));
  game.decide();
  EXPECT_NEAR(game.reward(0), -0.001, 1e-6) << "and coming back pays nothing";
  game.put(0, game.switch_x(0) - 60, game.switch_y(0));
  game.decide();
  EXPECT_NEAR(game.reward(0), 0.05 + 0.0005 * 40 - 0.001, 1e-4);
  EXPECT_EQ(game.user(kZonesA), 1);
}

TEST(RhythmSync, TheMeasurementsAreTheAgentsOwn) {
  Game game;
  game.put(0, game.switch_x(0) - 40, game.switch_y(0) + 30),
      game.put(1, game.switch_x(1) - 300, game.switch_y(1));
  game.decide();
  const int count = game.env.shape().measurement_count;
  ASSERT_EQ(count, 10);
  std::vector<float> measured(2 * static_cast<std::size_t>(count));
  ObservationTarget target;
  target.measurement = measured.data();
  game.env.observe_numbers(target);
  EXPECT_FLOAT_EQ(measured[0], 0.05f) << "stage 1 of 20";
  EXPECT_NEAR(measured[6], 40.0 / 512, 0.004);
  EXPECT_NEAR(measured[7], -30.0 / 256, 0.008);
  EXPECT_NEAR(measured[8], 50.0 / 768, 0.003);
  EXPECT_FLOAT_EQ(measured[9], 1.0f) << "in the zone";
  EXPECT_NEAR(measured[10 + 6], 300.0 / 512, 0.004);
  EXPECT_FLOAT_EQ(measured[10 + 9], 0.0f);
}

TEST(RhythmSync, ThirtyLayoutsPassValidation) {
  EXPECT_LE(test::refusals_of_layouts(kScenario, 30), 3);
  Game longest(1, {{"stages", "28"}, {"room_width", "576"}, {"room_height", "288"}, {"use_range", "72"}});
  EXPECT_EQ(longest.user(kStages), 28);
  EXPECT_EQ(longest.script_error(), "");
}

TEST(RhythmSync, TheScriptedPairCompletesEveryStage) {
  for (uint64_t seed : {0, 1, 2, 47}) {
    const auto summary = play_oracle_episode(test::generated_game(kScenario, 1'000'007), seed);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_FLOAT_EQ(summary->score, 1.0f) << seed;
  }
}

TEST(RhythmSync, TheScriptedPairCompletesVariedRoomsToo) {
  for (uint64_t seed : {0, 1, 2, 47}) {
    const auto game = test::generated_game(kScenario, 1'000'000 + seed, {{"variety", "1"}});
    const auto summary = play_oracle_episode(game, seed);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_FLOAT_EQ(summary->score, 1.0f) << seed;
  }
}

}  // namespace rhythm_sync_test
}  // namespace comrad::sim
