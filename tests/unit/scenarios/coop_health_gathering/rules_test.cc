// The script of Co-op Health Gathering on rooms made by hand, and random and scripted play on generated maps.
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>

#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/oracle/oracle.h"
#include "tests/support/level_builder.h"
#include "tests/support/scenario_stage.h"

namespace comrad::sim {
namespace rules_test {

using doom::to_fixed;

constexpr const char* kScenario = "coop_health_gathering";
constexpr int kFirstPickupExport = 57, kTetherNodeCount = 30;

/// A room of 4096 with tag 900 and starts at (-100, 0) and (100, 0).
std::shared_ptr<const doom::Level> arena() {
  doom::test::LevelBuilder builder;
  builder.room(builder.sector(0, 384, 900), -2048, -2048, 2048, 2048).thing(1, -100, 0).thing(2, 100, 0, 180);
  return builder.build();
}

/// What the layout would say: parameters, and kit spots far away in the north.
struct Layout {
  int tether = 400, damage = 5, kit_cap = 80, spot_count = 300;
  int spot_x = -1900, spot_y = 1500;

  std::string text() const {
    std::string x, y;
    for (int i = 0; i < spot_count; ++i) {
      x += (i == 0 ? "" : ", ") + std::to_string(spot_x + (i % 60) * 60);
      y += (i == 0 ? "" : ", ") + std::to_string(spot_y + (i / 60) * 60);
    }
    const std::string count = std::to_string(spot_count);
    return "#define PARAM_TETHER " + std::to_string(tether) + "\n#define PARAM_DAMAGE " +
           std::to_string(damage) + "\n#define PARAM_KIT_CAP " + std::to_string(kit_cap) +
           "\n#define KIT_SPOT_COUNT " + count + "\nint spot_x[" + count + "] = {" + x + "};\nint spot_y[" +
           count + "] = {" + y + "};\n";
  }
};

/// A world of two players with the script of the scenario.
struct Play : test::ScenarioStage {
  explicit Play(std::shared_ptr<const doom::Level> level, const Layout& layout = {}, uint64_t seed = 1)
      : ScenarioStage(kScenario, layout.text(), std::move(level), seed) {}
  int64_t distance() const {  // 16.16, as the tether measures
    const int64_t dx = std::abs(int64_t{world.body(0).x} - world.body(1).x);
    const int64_t dy = std::abs(int64_t{world.body(0).y} - world.body(1).y);
    return std::max(dx, dy) + std::min(dx, dy) / 2;
  }
};

/// No kits, no harm: only the tether.
constexpr Layout kPeace{.damage = 0, .kit_cap = 0};

TEST(CoopHealthGatheringRules, WithoutKitsTheTwentiethHitKillsAtClock640) {
  Play play(arena());
  play.tics(640);
  EXPECT_TRUE(play.world.player(0).alive && play.world.player(1).alive);
  EXPECT_EQ(play.world.player(0).health, 5);
  play.tics(1);
  EXPECT_FALSE(play.world.player(0).alive || play.world.player(1).alive);
  EXPECT_EQ(play.world.player(0).death_tic, 640u);
  EXPECT_FALSE(play.world.level_exited()) << "the map ends one tic later";
  play.tics(1);
  EXPECT_TRUE(play.world.level_exited());
}

TEST(CoopHealthGatheringRules, TheLayoutSetsHowMuchTheFloorHurts) {
  Play play(arena(), {.damage = 7});
  play.tics(33);
  EXPECT_EQ(play.world.player(0).health, 93);
}

TEST(CoopHealthGatheringRules, ThreeKitsComeEverySecondUpToTheCap) {
  Play play(arena(), {.damage = 0});
  play.tics(1);
  EXPECT_EQ(play.user(1), 3);
  play.tics(34);
  EXPECT_EQ(play.user(1), 3);
  play.tics(1);
  EXPECT_EQ(play.user(1), 6);
  play.tics(35 * 40);
  EXPECT_EQ(play.user(1), 80);
  EXPECT_EQ(play.user(2), 80);
  EXPECT_EQ(play.count("Stimpack") + play.count("Medikit"), 80);
}

TEST(CoopHealthGatheringRules, ThreeOfFourKitsAreStimpacks) {
  int stimpacks = 0, medikits = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    Play play(arena(), {.damage = 0}, seed);
    play.tics(35 * 28);
    stimpacks += play.count("Stimpack");
    medikits += play.count("Medikit");
  }
  ASSERT_EQ(stimpacks + medikits, 40 * 80);
  EXPECT_NEAR(stimpacks / 3200.0, 0.75, 0.04);  // more than five standard deviations
}

TEST(CoopHealthGatheringRules, KitsUseEverySpotAlike) {
  Play play(arena(), {.damage = 0, .kit_cap = 2000, .spot_count = 4});
  play.tics(35 * 400);
  std::map<doom::Fixed, int> at_x;
  for (const doom::Actor& actor : play.world.actors())
    if (actor.has(doom::ActorFlag::kSpecial)) ++at_x[actor.x];
  ASSERT_EQ(at_x.size(), 4u);
  for (const auto& [x, count] : at_x) EXPECT_NEAR(count, 300, 85);
}

TEST(CoopHealthGatheringRules, AKitHealsAndIsCounted) {
  // One spot, right in the way of the first player.
  doom::test::LevelBuilder builder;
  builder.room(builder.sector(0, 384, 900), -512, -512, 512, 512).thing(1, -100, 0).thing(2, 100, 0, 180);
  Play play(builder.build(), {.kit_cap = 1, .spot_count = 1, .spot_x = -60, .spot_y = 0});
  play.tics(36);
  ASSERT_EQ(play.user(1), 1);
  ASSERT_EQ(play.world.player(0).health, 95);
  doom::Buttons forward;
  forward.forward = true;
  play.tics(8, forward);  // walks east, over the kit
  EXPECT_EQ(play.world.player(0).health, 100);
  EXPECT_EQ(play.user(4), 1);
  EXPECT_EQ(play.user(1), 0);
  EXPECT_EQ(play.user(kFirstPickupExport), 1);
  EXPECT_EQ(play.user(kFirstPickupExport + 1), 0);
  play.tics(35);
  EXPECT_EQ(play.user(2), 2) << "a new one takes its place";
}

TEST(CoopHealthGatheringRules, AnOverstretchedPairIsPulledBackAndCounted) {
  Play play(arena(), kPeace);
  doom::Buttons backward;
  backward.backward = true;  // they face each other, so this takes them apart
  int tic = 0;
  while (play.user(3) == 0 && tic < 200) play.tics(1, backward, backward), ++tic;
  ASSERT_EQ(play.user(3), 1);
  EXPECT_GT(tic, 5);
  // 400 - 24, give or take the rounding of the halves.
  EXPECT_NEAR(static_cast<double>(play.distance()) / 65536.0, 376.0, 0.01);
  EXPECT_NEAR(doom::to_double(play.world.body(0).x + play.world.body(1).x), 0.0, 0.5)
      << "about their midpoint";
  EXPECT_GT(play.user(5), 0) << "the bar flashes";
  play.tics(50);  // their momentum may pull once more before they stand
  EXPECT_EQ(play.user(5), 0);
  const int32_t stretches = play.user(3);
  EXPECT_LE(play.distance(), to_fixed(400));
  while (play.user(3) == stretches && tic < 400) play.tics(1, backward, backward), ++tic;
  EXPECT_EQ(play.user(3), stretches + 1) << "pulling on counts again";
}

TEST(CoopHealthGatheringRules, APairThatStaysWithinItsTetherIsLeftAlone) {
  Play play(arena(), kPeace);
  play.tics(100);
  EXPECT_EQ(play.user(3), 0);
  EXPECT_EQ(play.world.body(0).x, to_fixed(-100));
}

TEST(CoopHealthGatheringRules, ABlockedPairIsCountedOnce) {
  // Each in its own cell: no pull can bring them together.
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 384, 900);
  builder.room(room, -340, -40, -260, 40)
      .room(room, 260, -40, 340, 40)
      .thing(1, -300, 0)
      .thing(2, 300, 0, 180);
  Play play(builder.build(), kPeace);
  play.tics(50);
  EXPECT_EQ(play.user(3), 1);
  EXPECT_EQ(play.user(5), 0);
}

TEST(CoopHealthGatheringRules, WhereOneIsBlockedTheOtherTakesTheWholePull) {
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 384, 900);
  builder.room(room, -340, -40, -260, 40)
      .room(room, -200, -400, 600, 400)
      .thing(1, -300, 0)
      .thing(2, 300, 0, 180);
  Play play(builder.build(), kPeace);
  play.tics(2);  // ids, then the first pull
  EXPECT_EQ(play.world.body(0).x, to_fixed(-300));
  EXPECT_NEAR(doom::to_double(play.world.body(1).x), 76.0, 0.01);
  EXPECT_EQ(play.user(3), 1);
}

TEST(CoopHealthGatheringRules, TheTetherShowsThirtyNodesInTheColourOfItsStrain) {
  Play play(arena(), kPeace);
  play.tics(6);
  EXPECT_EQ(play.count("TetherCalm"), kTetherNodeCount);
  doom::Fixed last = to_fixed(-100);
  for (const doom::Actor& actor : play.world.actors()) {
    if (play.world.catalog()[actor.type].name != "TetherCalm") continue;
    EXPECT_GT(actor.x, last) << "from the first player to the second";
    EXPECT_LT(actor.x, to_fixed(100));
    EXPECT_EQ(actor.z, to_fixed(20));
    last = actor.x;
  }
  doom::Buttons backward;
  backward.backward = true;
  bool was_warn = false, was_hot = false;
  for (int i = 0; i < 100; ++i) {
    play.tics(1, backward, backward);
    was_warn |= play.count("TetherWarn") == kTetherNodeCount;
    was_hot |= play.count("TetherHot") == kTetherNodeCount;
    ASSERT_EQ(play.count("TetherCalm") + play.count("TetherWarn") + play.count("TetherHot"),
              kTetherNodeCount);
  }
  EXPECT_TRUE(was_warn && was_hot);
}

TEST(CoopHealthGatheringRules, NodesBlockNobody) {
  Play play(arena(), kPeace);
  play.tics(6);
  doom::Buttons forward;
  forward.forward = true;
  play.tics(24, forward);
  EXPECT_GT(play.world.body(0).x, to_fixed(-40)) << "walked along its own tether";
}

TEST(CoopHealthGatheringRules, EachPlayerSeesABarOfTwentySegments) {
  Play play(arena(), kPeace);
  play.tics(2);
  const auto& messages = play.world.state().scripts.hud_messages;
  ASSERT_EQ(messages.size(), 2u);
  for (const doom::acs::HudMessage& message : messages) {
    EXPECT_NE(message.player, -1);
    EXPECT_EQ(message.text, "\034[Green]IIIIIIIIII\034[Black]IIIIIIIIII") << "200 of 400 units";
  }
  EXPECT_NE(messages[0].player, messages[1].player);
}

TEST(CoopHealthGatheringRules, AResetStartsTheRulesAnew) {
  Play used(arena()), fresh(arena());
  doom::Buttons backward;
  backward.backward = true;
  used.tics(300, backward, backward);
  reset_world(used.world, {.player_count = 2, .seed = 1});
  used.tics(100);
  fresh.tics(100);
  EXPECT_EQ(used.world.hash(), fresh.world.hash());
}

/// Mean and extremes of J over episodes of random play on the default map: as with the rules in C++ that the
/// script replaces (648.6 +- 2.8).
TEST(CoopHealthGatheringRules, RandomPlayOnTheDefaultMapLastsAsLongAsExpected) {
  DoomEnvironment env(test::generated_game(kScenario));
  constexpr int kEpisodes = 40;
  double sum = 0;
  for (int episode = 0; episode < kEpisodes; ++episode) {
    env.reset(RngKey(1).split(static_cast<uint64_t>(episode)).bits());
    Rng rng(RngKey(2).split(static_cast<uint64_t>(episode)));
    std::vector<int32_t> action(6);
    while (!env.last_step().episode_over()) {
      for (int32_t& choice : action) choice = static_cast<int32_t>(rng.below(3));
      env.step(action);
    }
    EXPECT_TRUE(env.last_step().terminated);
    ASSERT_GE(env.summary().score, 642.0f);
    sum += env.summary().score;
  }
  RecordProperty("J_mean", std::to_string(sum / kEpisodes));
  EXPECT_GT(sum / kEpisodes, 642.0);
  EXPECT_LT(sum / kEpisodes, 670.0);
}

TEST(CoopHealthGatheringRules, TheScriptedTeamLivesToTheLimit) {
  for (uint64_t seed : {1'000'000, 1'000'001}) {
    const auto summary = play_oracle_episode(test::generated_game(kScenario, seed), seed);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_GE(summary->score, 0.9 * 8400);
  }
}

TEST(CoopHealthGatheringRules, ThreeAndFourPlayOnTheSameMap) {
  for (const int agents : {3, 4}) {
    test::ScenarioGame game(kScenario, 1, {}, agents);
    game.decide(20);
    EXPECT_EQ(game.count("TetherCalm") + game.count("TetherWarn") + game.count("TetherHot"),
              (agents - 1) * kTetherNodeCount);
    EXPECT_EQ(game.script_error(), "");
  }
}

}  // namespace rules_test
}  // namespace comrad::sim
