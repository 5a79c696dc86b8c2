#include "sim_workers/env/rules/coop_health_gathering.h"

#include <gtest/gtest.h>

#include <memory>

#include "doomgen/layout/wad_writer.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/env/doom_env.h"
#include "tests/support/level_builder.h"

namespace comrad::sim {
namespace {

using doom::to_fixed;

/// A room of 4096 with tag 900, starts at (-100, 0) and (100, 0), kit spots far away in the north.
std::shared_ptr<const doom::Level> arena(int spot_count = 300, int spot_y = 1500) {
  doom::test::LevelBuilder builder;
  builder.room(builder.sector(0, 384, 900), -2048, -2048, 2048, 2048).thing(1, -100, 0).thing(2, 100, 0, 180);
  for (int i = 0; i < spot_count; ++i)
    builder.thing(scenarios::kMapSpotEditorNumber, -1900 + (i % 60) * 60, spot_y + (i / 60) * 60, 0,
                  scenarios::kFirstSpotId + i);
  return builder.build();
}

/// A world of two players with the rules of the scenario.
struct Play {
  explicit Play(std::shared_ptr<const doom::Level> level, std::map<std::string, int64_t> parameters = {},
                uint64_t seed = 1) {
    auto catalog = std::make_shared<doom::ActorCatalog>();
    CoopHealthGatheringRules::add_actors(*catalog);
    rules = CoopHealthGatheringRules::make({"coop_health_gathering", 42, 0, std::move(parameters)}, *catalog);
    world = std::make_unique<doom::World>(std::move(level), catalog);
    world->reset({.player_count = 2, .seed = seed}, rules.get());
  }
  void tics(int count, doom::Buttons first = {}, doom::Buttons second = {}) {
    const std::array<doom::Buttons, 2> buttons = {first, second};
    for (int i = 0; i < count; ++i) world->tic(buttons);
  }
  int count(const char* name) const { return world->count_actors(*world->catalog().find(name)); }
  int64_t distance() const {  // 16.16, as the tether measures
    const int64_t dx = std::abs(int64_t{world->body(0).x} - world->body(1).x);
    const int64_t dy = std::abs(int64_t{world->body(0).y} - world->body(1).y);
    return std::max(dx, dy) + std::min(dx, dy) / 2;
  }
  std::unique_ptr<NativeRules> rules;
  std::unique_ptr<doom::World> world;
};

TEST(CoopHealthGatheringRules, WithoutKitsTheTwentiethHitKillsAtClock640) {
  Play play(arena());
  play.tics(640);
  EXPECT_TRUE(play.world->player(0).alive && play.world->player(1).alive);
  EXPECT_EQ(play.world->player(0).health, 5);
  play.tics(1);
  EXPECT_FALSE(play.world->player(0).alive || play.world->player(1).alive);
  EXPECT_EQ(play.world->player(0).death_tic, 640u);
  EXPECT_FALSE(play.world->level_exited()) << "the map ends one tic later";
  play.tics(1);
  EXPECT_TRUE(play.world->level_exited());
}

TEST(CoopHealthGatheringRules, TheLayoutSaysHowMuchTheFloorHurts) {
  Play play(arena(), {{"damage", 7}});
  play.tics(33);
  EXPECT_EQ(play.world->player(0).health, 93);
}

TEST(CoopHealthGatheringRules, ThreeKitsComeEverySecondUpToTheCap) {
  Play play(arena(), {{"damage", 0}});
  play.tics(1);
  EXPECT_EQ(play.world->exported(1), 3);
  play.tics(34);
  EXPECT_EQ(play.world->exported(1), 3);
  play.tics(1);
  EXPECT_EQ(play.world->exported(1), 6);
  play.tics(35 * 40);
  EXPECT_EQ(play.world->exported(1), 80);
  EXPECT_EQ(play.world->exported(2), 80);
  EXPECT_EQ(play.count("Stimpack") + play.count("Medikit"), 80);
}

TEST(CoopHealthGatheringRules, ThreeOfFourKitsAreStimpacks) {
  int stimpacks = 0, medikits = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    Play play(arena(), {{"damage", 0}}, seed);
    play.tics(35 * 28);
    stimpacks += play.count("Stimpack");
    medikits += play.count("Medikit");
  }
  ASSERT_EQ(stimpacks + medikits, 40 * 80);
  EXPECT_NEAR(stimpacks / 3200.0, 0.75, 0.04);  // more than five standard deviations
}

TEST(CoopHealthGatheringRules, KitsUseEverySpotAlike) {
  Play play(arena(4), {{"damage", 0}, {"kit_cap", 2000}});
  play.tics(35 * 400);
  std::map<doom::Fixed, int> at_x;
  for (const doom::Actor& actor : play.world->actors())
    if (play.world->catalog()[actor.type].pickup) ++at_x[actor.x];
  ASSERT_EQ(at_x.size(), 4u);
  for (const auto& [x, count] : at_x) EXPECT_NEAR(count, 300, 85);
}

TEST(CoopHealthGatheringRules, AKitHealsAndIsCounted) {
  // One spot, right where the first player stands.
  doom::test::LevelBuilder builder;
  builder.room(builder.sector(0, 384, 900), -512, -512, 512, 512).thing(1, -100, 0).thing(2, 100, 0, 180);
  builder.thing(scenarios::kMapSpotEditorNumber, -60, 0, 0, scenarios::kFirstSpotId);
  Play play(builder.build(), {{"kit_cap", 1}});
  play.tics(36);
  ASSERT_EQ(play.world->exported(1), 1);
  ASSERT_EQ(play.world->player(0).health, 95);
  doom::Buttons forward;
  forward.forward = true;
  play.tics(8, forward);  // walks east, over the kit
  EXPECT_EQ(play.world->player(0).health, 100);
  EXPECT_EQ(play.world->exported(4), 1);
  EXPECT_EQ(play.world->exported(1), 0);
  EXPECT_EQ(play.world->exported(CoopHealthGatheringRules::kFirstPickupExport), 1);
  EXPECT_EQ(play.world->exported(CoopHealthGatheringRules::kFirstPickupExport + 1), 0);
  play.tics(35);
  EXPECT_EQ(play.world->exported(2), 2) << "a new one takes its place";
}

TEST(CoopHealthGatheringRules, AnOverstretchedPairIsPulledBackAndCounted) {
  Play play(arena(0), {{"damage", 0}});
  doom::Buttons backward;
  backward.backward = true;  // they face each other, so this takes them apart
  int tic = 0;
  while (play.world->exported(3) == 0 && tic < 200) play.tics(1, backward, backward), ++tic;
  ASSERT_EQ(play.world->exported(3), 1);
  EXPECT_GT(tic, 5);
  // 400 - 24, give or take the rounding of the halves.
  EXPECT_NEAR(static_cast<double>(play.distance()) / 65536.0, 376.0, 0.01);
  EXPECT_NEAR(doom::to_double(play.world->body(0).x + play.world->body(1).x), 0.0, 0.5)
      << "about their midpoint";
  EXPECT_GT(play.world->exported(5), 0) << "the bar flashes";
  play.tics(50);  // their momentum may pull once more before they stand
  EXPECT_EQ(play.world->exported(5), 0);
  const int32_t stretches = play.world->exported(3);
  EXPECT_LE(play.distance(), to_fixed(400));
  while (play.world->exported(3) == stretches && tic < 400) play.tics(1, backward, backward), ++tic;
  EXPECT_EQ(play.world->exported(3), stretches + 1) << "pulling on counts again";
}

TEST(CoopHealthGatheringRules, APairThatStaysWithinItsTetherIsLeftAlone) {
  Play play(arena(0), {{"damage", 0}});
  play.tics(100);
  EXPECT_EQ(play.world->exported(3), 0);
  EXPECT_EQ(play.world->body(0).x, to_fixed(-100));
}

TEST(CoopHealthGatheringRules, ABlockedPairIsCountedOnce) {
  // Each in a cell of its own: no pull can bring them together.
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 384, 900);
  builder.room(room, -340, -40, -260, 40)
      .room(room, 260, -40, 340, 40)
      .thing(1, -300, 0)
      .thing(2, 300, 0, 180);
  Play play(builder.build(), {{"damage", 0}});
  play.tics(50);
  EXPECT_EQ(play.world->exported(3), 1);
  EXPECT_EQ(play.world->exported(5), 0);
}

TEST(CoopHealthGatheringRules, WhereOneIsBlockedTheOtherTakesTheWholePull) {
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 384, 900);
  builder.room(room, -340, -40, -260, 40)
      .room(room, -200, -400, 600, 400)
      .thing(1, -300, 0)
      .thing(2, 300, 0, 180);
  Play play(builder.build(), {{"damage", 0}});
  play.tics(1);
  EXPECT_EQ(play.world->body(0).x, to_fixed(-300));
  EXPECT_NEAR(doom::to_double(play.world->body(1).x), 76.0, 0.01);
  EXPECT_EQ(play.world->exported(3), 1);
}

TEST(CoopHealthGatheringRules, TheTetherShowsThirtyNodesInTheColourOfItsStrain) {
  Play play(arena(0), {{"damage", 0}});
  play.tics(6);
  EXPECT_EQ(play.count("TetherCalm"), CoopHealthGatheringRules::kTetherNodeCount);
  doom::Fixed last = to_fixed(-100);
  for (const doom::Actor& actor : play.world->actors()) {
    if (play.world->catalog()[actor.type].name != "TetherCalm") continue;
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
    was_warn |= play.count("TetherWarn") == CoopHealthGatheringRules::kTetherNodeCount;
    was_hot |= play.count("TetherHot") == CoopHealthGatheringRules::kTetherNodeCount;
    ASSERT_EQ(play.count("TetherCalm") + play.count("TetherWarn") + play.count("TetherHot"),
              CoopHealthGatheringRules::kTetherNodeCount);
  }
  EXPECT_TRUE(was_warn && was_hot);
}

TEST(CoopHealthGatheringRules, NodesBlockNobody) {
  Play play(arena(0), {{"damage", 0}});
  play.tics(6);
  doom::Buttons forward;
  forward.forward = true;
  play.tics(16, forward);
  EXPECT_GT(play.world->body(0).x, to_fixed(-40)) << "walked along its own tether";
}

TEST(CoopHealthGatheringRules, EachPlayerSeesABarOfTwentySegments) {
  Play play(arena(0), {{"damage", 0}});
  play.tics(1);
  ASSERT_EQ(play.world->hud().size(), 40u);
  int lit = 0;
  for (const doom::HudBox& box : play.world->hud()) {
    EXPECT_FLOAT_EQ(box.y, 0.90f);
    EXPECT_GT(box.x, 0.0f);
    EXPECT_LT(box.x, 1.0f);
    lit += box.player == 0 && box.color[1] > 100;
  }
  EXPECT_EQ(lit, 10) << "200 of 400 units";
}

TEST(CoopHealthGatheringRules, AResetStartsTheRulesAnew) {
  Play used(arena()), fresh(arena());
  doom::Buttons backward;
  backward.backward = true;
  used.tics(300, backward, backward);
  used.world->reset({.player_count = 2, .seed = 1}, used.rules.get());
  EXPECT_EQ(used.rules->state_hash(), fresh.rules->state_hash());
  used.tics(100);
  fresh.tics(100);
  EXPECT_EQ(used.rules->state_hash(), fresh.rules->state_hash());
  EXPECT_EQ(used.world->hash(), fresh.world->hash());
}

TEST(CoopHealthGatheringRules, HostileParametersAreHeldInBounds) {
  Play play(arena(0), {{"tether", INT64_MIN}, {"damage", INT64_MAX}, {"kit_cap", -5}});
  play.tics(3);
  EXPECT_EQ(play.world->exported(1), 0);
}

/// Mean and extremes of J over episodes of random play on the default map.
TEST(CoopHealthGatheringRules, RandomPlayOnTheDefaultMapLastsAsLongAsExpected) {
  const std::string path = testing::TempDir() + "/comrad_chg_" + std::to_string(getpid()) + ".wad";
  const auto layout = scenarios::generate_layout("coop_health_gathering", {});
  ASSERT_TRUE(layout) << layout.error().message;
  ASSERT_TRUE(doomgen::write_file(path, layout->wad));
  EnvironmentOptions options;
  options.scenario = "coop_health_gathering";
  options.wad_path = path;
  const auto game = load_doom_game(options);
  std::remove(path.c_str());
  ASSERT_TRUE(game) << game.error().message;
  DoomEnvironment env(*game);
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
    ASSERT_GE(env.summary().score, 642.0f);
    sum += env.summary().score;
  }
  RecordProperty("J_mean", std::to_string(sum / kEpisodes));
  std::printf("random play: J = %.1f tics over %d episodes\n", sum / kEpisodes, kEpisodes);
  EXPECT_GT(sum / kEpisodes, 642.0);
  EXPECT_LT(sum / kEpisodes, 720.0);
}

}  // namespace
}  // namespace comrad::sim
