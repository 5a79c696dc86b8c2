// Who sees whom, and how far a noise reaches.
#include "sim_workers/engine/play/sight.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace sight_test {

using test::LevelBuilder;
using test::Stage;

TEST(CanSee, WallsHideAndOpenGroundDoesNot) {
  LevelBuilder builder = test::big_room();
  builder.pillar(0, 200, -64, 264, 64);
  Stage stage(builder.build());
  Actor& near = stage.spawn("Demon", 150, 0);
  Actor& hidden = stage.spawn("Demon", 400, 0);
  Actor& beside = stage.spawn("Demon", 400, 300);
  EXPECT_TRUE(can_see(stage.world, near, stage.body()));
  EXPECT_FALSE(can_see(stage.world, hidden, stage.body()));
  EXPECT_FALSE(can_see(stage.world, stage.body(), hidden));
  EXPECT_TRUE(can_see(stage.world, beside, stage.body()));
  EXPECT_TRUE(can_see(stage.world, near, near));
}

TEST(CanSee, AFloorInBetweenHidesWhatIsLowBehindIt) {
  for (const int height : {30, 46, 50, 130}) {
    LevelBuilder builder;
    const uint32_t room = builder.sector(0, 256), ridge = builder.sector(height, 256);
    builder.room(room, -512, -512, 512, 512).island(ridge, room, -16, -512, 16, 512).thing(1, -400, 0);
    Stage stage(builder.build());
    Actor& other = stage.spawn("DoomImp", 400, 0);
    // Eyes at 42 of 56, the ridge's edge 384 of 800 units away: it hides what lies below 42 + (height - 42) *
    // 800 / 384, so one of 30 hides nothing, one of 46 leaves the head (50 to 56), one of 50 nothing.
    EXPECT_EQ(can_see(stage.world, other, stage.body()), height < 48) << height;
    other.z = to_fixed(150);
    // From eyes at 192 the look over its far edge comes down to 192 + (height - 192) * 800 / 416: 73 for one
    // of 130.
    EXPECT_EQ(can_see(stage.world, other, stage.body()), height < 120) << height;
    // Somebody on the ridge is in full view.
    Actor& above = stage.spawn("DoomImp", 0, 0, 0, height);
    EXPECT_TRUE(can_see(stage.world, other, above));
  }
}

TEST(CanSee, FollowsPlanesAndFlagsThatChangeDuringPlay) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256), door = builder.sector(0, 0);
  builder.room(room, -512, -512, 512, 512).island(door, room, -16, -512, 16, 512).thing(1, -400, 0);
  Stage stage(builder.build());
  const Actor& other = stage.spawn("DoomImp", 400, 0);
  EXPECT_FALSE(can_see(stage.world, other, stage.body()));
  // From eyes at 42 the look below a door of 24 comes down to 42 - 18 * 800 / 384 = 4.5: it sees the boots;
  // below one of 20 it ends in the floor.
  stage.world.state().sectors[door].ceiling_height = to_fixed(20);
  EXPECT_FALSE(can_see(stage.world, other, stage.body()));
  stage.world.state().sectors[door].ceiling_height = to_fixed(24);
  EXPECT_TRUE(can_see(stage.world, other, stage.body()));
  stage.world.state().sectors[door].floor_height = to_fixed(24);
  EXPECT_FALSE(can_see(stage.world, other, stage.body()));
  stage.world.state().sectors[door].floor_height = 0;
  stage.world.state().sectors[door].ceiling_height = to_fixed(256);
  for (LineState& line : stage.world.state().lines) line.flags |= kLineBlocking;  // a grating
  EXPECT_TRUE(can_see(stage.world, other, stage.body()));
  stage.world.state().lines[4].flags |= kLineBlockSight;  // the door's western side
  EXPECT_FALSE(can_see(stage.world, other, stage.body()));
}

/// Do the open segments cross? Written straight from the geometry, in floating point.
bool segments_cross(double ax, double ay, double bx, double by, double cx, double cy, double dx, double dy,
                    bool& doubtful) {
  const auto side = [](double px, double py, double qx, double qy, double x, double y) {
    return (qx - px) * (y - py) - (qy - py) * (x - px);
  };
  const double one = side(ax, ay, bx, by, cx, cy), two = side(ax, ay, bx, by, dx, dy);
  const double three = side(cx, cy, dx, dy, ax, ay), four = side(cx, cy, dx, dy, bx, by);
  for (const double value : {one, two, three, four}) doubtful |= std::abs(value) < 1e-6;
  return (one > 0) != (two > 0) && (three > 0) != (four > 0);
}

TEST(CanSee, AgreesWithALookAtEveryWall) {
  std::mt19937 random(7);
  LevelBuilder builder = test::big_room();
  for (int i = 0; i < 40; ++i) {
    const int x = static_cast<int>(random() % 13) * 150 - 950,
              y = static_cast<int>(random() % 13) * 150 - 950;
    builder.pillar(0, x, y, x + 10 + static_cast<int>(random() % 90),
                   y + 10 + static_cast<int>(random() % 90));
  }
  Stage stage(builder.build());
  Actor& from = stage.spawn("DoomImp", 0, 0);
  Actor& to = stage.spawn("DoomImp", 0, 0);
  const Level& level = stage.world.level();
  int seen = 0, compared = 0;
  for (int i = 0; i < 5000; ++i) {
    for (Actor* actor : {&from, &to}) {
      actor->x = static_cast<Fixed>(random() % (2000u << 16)) - to_fixed(1000);
      actor->y = static_cast<Fixed>(random() % (2000u << 16)) - to_fixed(1000);
    }
    bool open = true, doubtful = false;
    for (const Linedef& line : level.linedefs) {
      const Vertex &start = level.vertices[line.start], &end = level.vertices[line.end];
      open &= !segments_cross(to_double(from.x), to_double(from.y), to_double(to.x), to_double(to.y),
                              to_double(start.x), to_double(start.y), to_double(end.x), to_double(end.y),
                              doubtful);
    }
    if (doubtful) continue;
    ++compared, seen += open;
    ASSERT_EQ(can_see(stage.world, from, to), open)
        << to_double(from.x) << ' ' << to_double(from.y) << ' ' << to_double(to.x) << ' ' << to_double(to.y);
    ASSERT_EQ(can_see(stage.world, to, from), open);
  }
  EXPECT_GT(compared, 4900);
  EXPECT_GT(seen, 200);
  EXPECT_LT(seen, 4000);
}

/// Rooms in a row, 200 units each, joined by two-sided lines from which on "flags" holds.
std::shared_ptr<const Level> rooms_in_a_row(int count, uint32_t joint_flags) {
  Level level;
  for (int i = 0; i < count; ++i) {
    Sector sector;
    sector.ceiling_height = to_fixed(128);
    level.sectors.push_back(sector);
  }
  for (int i = 0; i <= count; ++i)
    for (const int y : {0, 200}) level.vertices.push_back({to_fixed(200 * i), to_fixed(y)});
  const auto side = [&](uint32_t sector) {
    level.sidedefs.push_back({.top = "-", .bottom = "-", .middle = "-", .sector_index = sector});
    return static_cast<uint32_t>(level.sidedefs.size() - 1);
  };
  const auto line = [&](uint32_t start, uint32_t end, uint32_t front, std::optional<uint32_t> back,
                        uint32_t flags) {
    Linedef linedef;
    linedef.start = start, linedef.end = end, linedef.flags = flags;
    linedef.front = side(front);
    if (back) linedef.back = side(*back);
    level.linedefs.push_back(linedef);
  };
  for (uint32_t i = 0; i < static_cast<uint32_t>(count); ++i) {
    line(2 * i + 2, 2 * i, i, std::nullopt, kLineBlocking);      // south
    line(2 * i + 1, 2 * i + 3, i, std::nullopt, kLineBlocking);  // north
    if (i > 0) line(2 * i, 2 * i + 1, i, i - 1, kLineTwoSided | joint_flags);
  }
  line(0, 1, 0, std::nullopt, kLineBlocking);
  line(2 * static_cast<uint32_t>(count) + 1, 2 * static_cast<uint32_t>(count),
       static_cast<uint32_t>(count - 1), std::nullopt, kLineBlocking);
  MapThing start;
  start.editor_number = 1, start.x = start.y = to_fixed(100);
  start.flags = kThingSkill1 * 31 | kThingSingle | kThingCoop;
  level.things.push_back(start);
  complete_level(level);
  return std::make_shared<const Level>(level);
}

/// How many rooms from the west hear a noise of the player in the first one.
int rooms_that_hear(Stage& stage, int count) {
  std::vector<uint32_t> ids;
  for (int i = 0; i < count; ++i) ids.push_back(stage.spawn("DoomImp", 200 * i + 120, 60).id);
  alert_monsters(stage.world, stage.body(), stage.body());
  int heard = 0;
  for (const uint32_t id : ids) heard += stage.at(id).last_heard_id == stage.body().id;
  return heard;
}

TEST(AlertMonsters, PassesOpeningsAndOneLineThatBlocksSound) {
  Stage open(rooms_in_a_row(5, 0));
  EXPECT_EQ(rooms_that_hear(open, 5), 5);
  Stage muffled(rooms_in_a_row(5, kLineSoundBlock));
  EXPECT_EQ(rooms_that_hear(muffled, 5), 2);
}

TEST(AlertMonsters, StopsAtAShutDoorAndAtItsDistance) {
  Stage stage(rooms_in_a_row(5, 0));
  stage.world.state().sectors[2].ceiling_height = 0;
  EXPECT_EQ(rooms_that_hear(stage, 5), 2);
  stage.world.state().sectors[2].ceiling_height = to_fixed(128);
  Actor& far = stage.spawn("DoomImp", 700, 100);
  far.last_heard_id = 0;
  alert_monsters(stage.world, stage.body(), stage.body(), to_fixed(300));
  EXPECT_EQ(far.last_heard_id, 0u);
  alert_monsters(stage.world, stage.body(), stage.body(), to_fixed(800));
  EXPECT_EQ(far.last_heard_id, stage.body().id);
}

}  // namespace sight_test
}  // namespace comrad::doom
