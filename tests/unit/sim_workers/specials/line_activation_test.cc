// Line specials from end to end: a player walks and presses use, a monster walks, a bullet flies, and the
// map answers.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "doomgen/wad/doom_specials.h"
#include "doomgen/wad/special_names.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace line_activation_test {

using test::LevelBuilder;
using test::Stage;

constexpr uint32_t kUse = kLinePlayerUse, kCross = kLinePlayerCross, kAgain = kLineRepeatable;

/// A room with a strip of another sector, tag 7, across its middle (x 64..128). The player stands west of it
/// and looks east. Lines 4 to 7 are the strip's: west, north, east, south; their fronts are inside it.
struct Strip {
  explicit Strip(int floor = 0, int ceiling = 256) {
    const uint32_t room = builder.sector(0, 256);
    strip = builder.sector(floor, ceiling, 7);
    builder.room(room, -512, -512, 512, 512).island(strip, room, 64, -500, 128, 500).thing(1, 0, 0);
  }
  /// Turns a two-sided line round: its front is then outside.
  Strip& turn(uint32_t line) {
    std::swap(builder.line(line).start, builder.line(line).end);
    std::swap(builder.line(line).front, *builder.line(line).back);
    return *this;
  }
  /// Gives a line of the map a special.
  Strip& special(uint32_t line, int32_t number, std::array<int32_t, 5> args, uint32_t flags) {
    builder.line(line).special = number, builder.line(line).args = args;
    builder.line(line).flags |= flags;
    return *this;
  }
  std::unique_ptr<Stage> start(WorldOptions options = {}) {
    auto stage = std::make_unique<Stage>(builder.build(), options);
    stage->body().reaction_tics = 0;
    return stage;
  }
  LevelBuilder builder;
  uint32_t strip = 0;
};

Fixed floor_of(const Stage& stage) { return stage.world.sectors()[1].floor_height; }
Fixed ceiling_of(const Stage& stage) { return stage.world.sectors()[1].ceiling_height; }

void press_use(Stage& stage) {
  stage.buttons[0].use = true;
  stage.tics(1);
  stage.buttons[0].use = false;
  stage.tics(1);
}
/// Walks east until it stands at `x`, or `limit` tics have passed.
bool walk_to(Stage& stage, int x, int limit = 120) {
  stage.buttons[0].forward = true;
  const bool there = stage.tics_until(limit, [&] { return stage.body().x >= to_fixed(x); });
  stage.buttons[0].forward = false;
  return there;
}

// ---------------------------------------------------------------- use

TEST(UseLine, OpensADoorInReachOnlyAndOnlyWhenTheKeyGoesDown) {
  Strip strip(0, 0);
  strip.special(4, 12, {0, 16, 35, 0, 0}, kUse | kAgain).turn(4);
  auto stage = strip.start();
  set_position(stage->world, stage->body().id, to_fixed(-8), 0, 0);
  press_use(*stage);
  stage->tics(5);
  EXPECT_EQ(ceiling_of(*stage), 0) << "72 units away";
  set_position(stage->world, stage->body().id, to_fixed(16), 0, 0);
  stage->buttons[0].use = true;
  stage->tics(10);
  EXPECT_GT(ceiling_of(*stage), 0);
  // Still held: it opens, waits and closes as if it had been let go.
  stage->tics(126 - 10 + 35);
  EXPECT_EQ(ceiling_of(*stage), to_fixed(252));
  stage->tics(130);
  EXPECT_EQ(ceiling_of(*stage), 0);
}

TEST(UseLine, ALockedDoorWantsItsKey) {
  Strip strip(0, 0);
  strip.special(4, 13, {7, 16, 35, 1, 0}, kLinePlayerUseBack | kAgain);
  auto stage = strip.start();
  set_position(stage->world, stage->body().id, to_fixed(16), 0, 0);
  press_use(*stage);
  stage->tics(5);
  EXPECT_EQ(ceiling_of(*stage), 0);
  give_item(stage->world, 0, stage->catalog->find("RedCard").value(), 1);
  press_use(*stage);
  stage->tics(5);
  EXPECT_GT(ceiling_of(*stage), 0);
}

TEST(UseLine, ADoorClosingOnABodyOpensAgain) {
  Strip strip(0, 0);
  strip.special(4, 12, {7, 16, 35, 0, 0}, kLinePlayerUseBack | kAgain);
  auto stage = strip.start();
  set_position(stage->world, stage->body().id, to_fixed(16), 0, 0);
  press_use(*stage);
  stage->tics(120);
  set_position(stage->world, stage->body().id, to_fixed(96), 0, 0);
  Fixed lowest = to_fixed(256);
  for (int i = 0; i < 300; ++i) stage->tics(1), lowest = std::min(lowest, ceiling_of(*stage));
  EXPECT_GE(lowest, to_fixed(56));
  EXPECT_LT(lowest, to_fixed(60));
  EXPECT_EQ(stage->player().health, 100);
}

TEST(UseLine, ASwitchTurnsAndTurnsBackAfterASecond) {
  Strip strip;
  strip.special(3, 12, {7, 16, 0, 0, 0}, kUse | kAgain);  // the room's south wall
  auto level = strip.builder.build();
  Level with_switch = *level;
  with_switch.sidedefs[with_switch.linedefs[3].front].middle = "SW1BRN1";
  Stage stage(std::make_shared<const Level>(with_switch));
  const uint32_t side = with_switch.linedefs[3].front;
  set_position(stage.world, stage.body().id, 0, to_fixed(-470), 0);
  stage.world.set_angle(stage.body().id, 0u - kAngle90);
  press_use(stage);
  EXPECT_EQ(stage.world.sides()[side].middle, "SW2BRN1");
  stage.tics(40);
  EXPECT_EQ(stage.world.sides()[side].middle, "SW1BRN1");
}

TEST(UseLine, ALineWithoutTheRepeatFlagWorksOnce) {
  for (const bool again : {false, true}) {
    Strip strip;
    strip.special(3, 35, {7, 64, 1, 0, 0}, kUse | (again ? kAgain : 0u));  // Floor_RaiseByValueTimes8
    auto stage = strip.start();
    set_position(stage->world, stage->body().id, 0, to_fixed(-470), 0);
    stage->world.set_angle(stage->body().id, 0u - kAngle90);
    for (int i = 0; i < 3; ++i) {
      press_use(*stage);
      stage->tics(20);
    }
    EXPECT_EQ(floor_of(*stage), to_fixed(again ? 24 : 8));
  }
}

TEST(UseLine, AnExitSwitchEndsTheLevel) {
  Strip strip;
  strip.special(3, 243, {}, kUse);
  auto stage = strip.start();
  set_position(stage->world, stage->body().id, 0, to_fixed(-470), 0);
  stage->world.set_angle(stage->body().id, 0u - kAngle90);
  EXPECT_FALSE(stage->world.level_exited());
  press_use(*stage);
  EXPECT_TRUE(stage->world.level_exited());
}

// ---------------------------------------------------------------- cross

TEST(CrossLine, ALiftGoesDownWaitsAndComesBackWithItsRider) {
  Strip strip(24, 256);
  strip.special(4, 62, {7, 16, 35, 0, 0}, kCross | kAgain);  // Plat_DownWaitUpStay
  auto stage = strip.start();
  ASSERT_TRUE(walk_to(*stage, 84));
  stage->body().velocity_x = 0;  // or it would slide off
  stage->tics(14);
  EXPECT_LE(floor_of(*stage), to_fixed(8));
  EXPECT_EQ(stage->body().z, floor_of(*stage)) << "it rides";
  stage->tics(35 + 40);
  EXPECT_EQ(floor_of(*stage), to_fixed(24));
  EXPECT_EQ(stage->body().z, to_fixed(24));
}

TEST(CrossLine, ATeleporterPutsThePlayerAtItsDestination) {
  Strip strip;
  strip.special(4, 70, {5, 0, 0, 0, 0}, kCross | kAgain).turn(4);  // teleporters work from the front
  strip.builder.thing(14, -300, 200, 90, 5);
  auto stage = strip.start();
  stage->buttons[0].forward = true;
  ASSERT_TRUE(stage->tics_until(60, [&] { return stage->body().x < to_fixed(-200); }));
  EXPECT_EQ(stage->body().x, to_fixed(-300));
  EXPECT_NEAR(to_double(stage->body().y), 200, 1);
  EXPECT_EQ(stage->body().angle, kAngle90);
  const Fixed y = stage->body().y;
  stage->tics(10);
  EXPECT_NEAR(to_double(stage->body().y - y), 0, 1) << "it stands still for a while";
  stage->tics(20);
  EXPECT_GT(stage->body().y, y);
}

TEST(CrossLine, ATeleportFragsAnActorStandingThere) {
  Strip strip;
  strip.special(4, 70, {5, 0, 0, 0, 0}, kCross | kAgain).turn(4);  // teleporters work from the front
  strip.builder.thing(14, -300, 200, 90, 5);
  auto stage = strip.start();
  Actor& victim = stage->spawn("BaronOfHell", -300, 210);
  const uint32_t id = victim.id;
  victim.tics = -1;
  walk_to(*stage, 80, 40);
  EXPECT_LE(stage->at(id).health, 0);
  EXPECT_GT(stage->player().health, 0);
}

TEST(CrossLine, MonstersUseWhatIsTheirs) {
  const auto crosses = [](int32_t special, uint32_t flags) {
    Strip strip;
    strip.special(4, special, {7, special == 70 ? 0 : 64, special == 70 ? 0 : 64, 0, 0}, flags);
    strip.builder.thing(14, -300, 200, 90, 7);
    auto stage = strip.start();
    set_position(stage->world, stage->body().id, to_fixed(-400), to_fixed(-400), 0);
    Actor& imp = stage->spawn("DoomImp", 100, 0, 180);
    imp.move_direction = kWest;
    const uint32_t id = imp.id;
    for (int i = 0; i < 12; ++i)
      stage->at(id).move_direction = kWest, monster_move(stage->world, stage->at(id));
    stage->tics(30);
    return stage->at(id).x < to_fixed(-200) || floor_of(*stage) != 0;
  };
  EXPECT_TRUE(crosses(70, kCross | kAgain)) << "players' teleporters are theirs, too";
  EXPECT_FALSE(crosses(23, kCross | kAgain)) << "a player's floor trigger";
  EXPECT_TRUE(crosses(23, kLineMonsterCross | kAgain));
  EXPECT_TRUE(crosses(23, kCross | kAgain | kLineMonsterActivate));
}

// ---------------------------------------------------------------- shots, pushes, damage

TEST(ShootLine, ABulletOpensADoorThatWaitsForIt) {
  Strip strip(0, 0);
  strip.special(4, 11, {7, 64, 0, 0, 0}, kLineImpact);
  auto stage = strip.start();
  stage->tics(20);
  stage->buttons[0].attack = true;
  stage->tics(8);
  EXPECT_GT(ceiling_of(*stage), 0);
}

TEST(PushLine, ActsWhenAPlayerRunsIntoIt) {
  Strip strip(0, 0);
  strip.special(4, 11, {7, 64, 0, 0, 0}, kLinePlayerPush);
  auto stage = strip.start();
  walk_to(*stage, 60, 20);
  EXPECT_GT(ceiling_of(*stage), 0);
}

TEST(Crusher, HurtsWhoStandsBelowAndGoesUpAgain) {
  Strip strip(0, 128);
  strip.special(4, 42, {7, 64, 10, 0, 0}, kCross);  // Ceiling_CrushAndRaise
  auto stage = strip.start();
  stage->make_player_tough(10'000);
  ASSERT_TRUE(walk_to(*stage, 90));
  Fixed lowest = to_fixed(128), highest_after = 0;
  for (int i = 0; i < 400; ++i) {
    stage->tics(1);
    if (ceiling_of(*stage) < lowest) lowest = ceiling_of(*stage), highest_after = 0;
    highest_after = std::max(highest_after, ceiling_of(*stage));
  }
  EXPECT_LT(stage->player().health, 10'000 - 20);
  EXPECT_EQ(highest_after, to_fixed(128));
}

// ---------------------------------------------------------------- Doom's numbers

struct DoomLine {
  const char* name;
  int32_t doom_special;
  bool by_use;         ///< pressed from the back side of the line, else crossed
  int floor, ceiling;  ///< at first
  int tics;            ///< then
  int floor_after, ceiling_after;
};

class DoomSpecials : public ::testing::TestWithParam<DoomLine> {};

/// The strip is reached by a line in Doom's numbering (tag 7), translated as the loader of Doom-format maps
/// does it.
TEST_P(DoomSpecials, DoWhatTheyDoInDoom) {
  const DoomLine line = GetParam();
  wad::UdmfLinedef record;
  const auto translated = wad::translate_doom_line(line.doom_special, 7, record);
  ASSERT_TRUE(translated.has_value());
  ASSERT_EQ(record.player_use, line.by_use);
  ASSERT_EQ(record.player_cross, !line.by_use);
  Strip strip(line.floor, line.ceiling);
  // The trigger: the room's south wall for a press, a line of an island of the room's own height for a walk.
  uint32_t trigger = 3;
  uint32_t flags = kUse;
  if (!line.by_use) {
    const uint32_t plain = strip.builder.sector(0, 256);
    strip.builder.island(plain, 0, -64, -400, -32, -300);
    trigger = 8;
    flags = kCross;
  }
  strip.special(trigger, translated->special, translated->args, flags | kAgain);
  auto stage = strip.start();
  if (line.by_use) {
    set_position(stage->world, stage->body().id, 0, to_fixed(-470), 0);
    stage->world.set_angle(stage->body().id, 0u - kAngle90);
    press_use(*stage);
  } else {
    set_position(stage->world, stage->body().id, to_fixed(-90), to_fixed(-350), 0);
    walk_to(*stage, -62, 40);
  }
  stage->tics(line.tics);
  EXPECT_EQ(floor_of(*stage), to_fixed(line.floor_after));
  EXPECT_EQ(ceiling_of(*stage), to_fixed(line.ceiling_after));
}

INSTANTIATE_TEST_SUITE_P(
    Some, DoomSpecials,
    ::testing::Values(DoomLine{"S1_door_open_stay", 103, true, 0, 0, 200, 0, 252},
                      DoomLine{"SR_door_raise", 63, true, 0, 0, 600, 0, 0},
                      DoomLine{"W1_door_open_stay", 2, false, 0, 0, 200, 0, 252},
                      DoomLine{"SR_door_blazing_open", 114, true, 0, 0, 40, 0, 252},
                      DoomLine{"W1_door_close", 3, false, 0, 128, 100, 0, 0},
                      DoomLine{"W1_floor_lower_to_lowest", 38, false, 64, 256, 100, 0, 256},
                      DoomLine{"S1_floor_raise_to_nearest", 18, true, -64, 256, 200, 0, 256},
                      DoomLine{"WR_lift", 88, false, 64, 256, 300, 64, 256},
                      DoomLine{"S1_floor_lower_turbo", 71, true, 64, 256, 100, 8, 256},
                      DoomLine{"W1_raise_24", 58, false, 0, 256, 60, 24, 256}),
    [](const auto& line) { return std::string(line.param.name); });

// ---------------------------------------------------------------- the table of specials

TEST(SpecialSupport, IsWhatTheEngineExecutesWithoutAWarning) {
  for (const wad::SpecialName& special : wad::special_names()) {
    if (special.name.ends_with("ByTexture"))
      continue;  // they warn that every texture counts as 64 units high
    Strip strip;
    const auto stage = strip.start();
    stage->world.events().run_special(stage->world, {.number = special.number});
    const bool warned = !stage->world.index().warned_specials->first(special.number);
    EXPECT_EQ(special.support == wad::SpecialSupport::kSupported, !warned)
        << special.number << " " << special.name;
  }
}

}  // namespace line_activation_test
}  // namespace comrad::doom
