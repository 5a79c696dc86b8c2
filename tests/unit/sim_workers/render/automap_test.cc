#include "sim_workers/engine/render/automap.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "sim_workers/engine/render/labels.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace automap_test {

constexpr int kWidth = 320, kHeight = 240;

class RoomFromAbove : public testing::Test {
 protected:
  void SetUp() override { reset_world(world_, {.player_count = 2, .seed = 1}); }
  void draw(AutomapOptions options, std::vector<uint8_t> seen = {}) {
    draw_automap(world_, 0, options, seen, picture_.data());
  }
  bool is_drawn(int x, int y) const {
    const auto at = static_cast<std::size_t>(3 * (y * kWidth + x));
    return std::array{picture_[at], picture_[at + 1], picture_[at + 2]} !=
           std::array<uint8_t, 3>{111, 87, 67};
  }
  int count() const {
    int drawn = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) drawn += is_drawn(x, y);
    return drawn;
  }

  // 1024 units wide and high, player 0 at (-128, 0): 208 rows / 1024 / 0.7 are 0.29 pixels a unit.
  World world_{test::one_room(), std::make_shared<const ActorCatalog>()};
  std::vector<uint8_t> picture_ = std::vector<uint8_t>(3 * kWidth * kHeight);
};

TEST_F(RoomFromAbove, ThePlayerIsInTheMiddleAndWallsAreWhereTheMapHasThem) {
  draw({.width = kWidth, .height = kHeight, .mode = AutomapMode::kWhole});
  EXPECT_TRUE(is_drawn(160, 121));       // its arrow
  EXPECT_TRUE(is_drawn(160 - 112, 10));  // 384 units west, 111.4 pixels
  EXPECT_FALSE(is_drawn(160 - 110, 10) || is_drawn(160 - 114, 10));
  EXPECT_TRUE(is_drawn(160 + 74, 121));  // the other player, 256 units east
  EXPECT_FALSE(is_drawn(160, 60));
}

TEST_F(RoomFromAbove, TheWayAheadIsUpWhereTheMapRotates) {
  draw({.width = kWidth, .height = kHeight, .mode = AutomapMode::kWhole, .rotates = true});
  EXPECT_TRUE(is_drawn(160, 121 - 74));  // east, where the player looks
  EXPECT_FALSE(is_drawn(160 + 74, 121));
  EXPECT_TRUE(is_drawn(60, 121 + 111) || is_drawn(60, 121 + 112));  // the western wall lies across, below
}

TEST_F(RoomFromAbove, WallsThatNobodySawAreNotOnIt) {
  draw({.width = kWidth, .height = kHeight});
  const int unseen = count();
  draw({.width = kWidth, .height = kHeight}, {1, 1, 1, 1});
  const int all = count();
  EXPECT_LT(unseen, all);
  draw({.width = kWidth, .height = kHeight, .mode = AutomapMode::kWhole});
  EXPECT_EQ(count(), all);
}

TEST(AutomapMode, HasVizdoomsNames) {
  EXPECT_EQ(find_automap_mode("objects_with_size"), AutomapMode::kObjectsWithSize);
  EXPECT_EQ(find_automap_mode("NORMAL"), AutomapMode::kNormal);
  EXPECT_FALSE(find_automap_mode("ALL"));
}

/// A picture of one row with a pixel of each of `count` things, which were drawn in that order.
std::vector<ThingLabel> label_row(int count, std::vector<uint8_t>* labels) {
  DrawList list;
  StableList<Actor> actors;
  std::vector<uint32_t> subjects{kWallSubject, kPlaneSubject, kWeaponSubject};
  for (int thing = 0; thing < count; ++thing) {
    Actor actor;
    actor.id = 100 + static_cast<uint32_t>(thing);
    actors.push_back(actor);
    for (int part = 0; part < 2; ++part) list.strips.emplace_back().subject = kFirstActor + thing;
    subjects.push_back(static_cast<uint32_t>(kFirstActor + thing));
  }
  std::vector<ThingLabel> things;
  label_subjects(list, subjects, static_cast<int>(subjects.size()), actors, 7, labels, &things);
  return things;
}

TEST(Labels, ValuesAreSpreadAsVizdoomSpreadsThem) {
  std::vector<uint8_t> labels;
  const std::vector<ThingLabel> things = label_row(6, &labels);
  EXPECT_EQ(labels, (std::vector<uint8_t>{0, 1, 255, 36, 72, 109, 145, 182, 218}));
  ASSERT_EQ(things.size(), 7u);
  EXPECT_EQ(things[5].value, 218);
  EXPECT_EQ(things[5].actor_id, 105u);
  EXPECT_EQ(things[5].left, 8);
  EXPECT_EQ(things[5].right, 9);
  EXPECT_EQ(things[6].value, 255);
  EXPECT_EQ(things[6].actor_id, 7u);  // the one that looks holds it
}

TEST(Labels, OfTooManyTheFarthestHaveNone) {
  for (const int count : {126, 127, 253, 300}) {
    std::vector<uint8_t> labels;
    const std::vector<ThingLabel> things = label_row(count, &labels);
    ASSERT_EQ(things.size(), static_cast<std::size_t>(std::min(count, kLabelledThingsMax)) + 1) << count;
    EXPECT_GE(things.front().value, 2) << count;
    for (std::size_t at = 1; at < things.size(); ++at)
      EXPECT_GT(things[at].value, things[at - 1].value) << count;
    EXPECT_EQ(labels[3], count > kLabelledThingsMax ? 0 : things.front().value) << count;
  }
}

}  // namespace automap_test
}  // namespace comrad::doom
