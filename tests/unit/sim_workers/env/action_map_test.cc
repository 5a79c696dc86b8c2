#include "sim_workers/env/action_map.h"

#include <gtest/gtest.h>

namespace comrad::sim {
namespace action_map_test {

using scenarios::ActionHead;

TEST(ActionMap, IndexKPressesTheKthButtonOfItsHead) {
  const auto map = ActionMap::create(
      {{{"MOVE_FORWARD", "MOVE_BACKWARD"}}, {{"MOVE_RIGHT", "MOVE_LEFT"}}, {{"TURN_LEFT", "TURN_RIGHT"}}});
  ASSERT_TRUE(map);
  const auto pressed = [&](int32_t a, int32_t b, int32_t c) {
    return map->buttons(std::vector<int32_t>{a, b, c});
  };
  const doom::Buttons none = pressed(0, 0, 0);
  EXPECT_FALSE(none.forward || none.backward || none.left || none.right || none.turn_left || none.turn_right);
  EXPECT_TRUE(pressed(1, 0, 0).forward);
  EXPECT_TRUE(pressed(2, 0, 0).backward);
  EXPECT_FALSE(pressed(2, 0, 0).forward);
  EXPECT_TRUE(pressed(0, 1, 0).right);
  EXPECT_TRUE(pressed(0, 2, 0).left);
  EXPECT_TRUE(pressed(0, 0, 1).turn_left);
  EXPECT_TRUE(pressed(0, 0, 2).turn_right);
  const doom::Buttons all = pressed(1, 2, 2);
  EXPECT_TRUE(all.forward && all.left && all.turn_right);
}

TEST(ActionMap, ChoicesOutOfRangePressNothing) {
  const auto map = ActionMap::create({{{"ATTACK"}}});
  ASSERT_TRUE(map);
  for (const int32_t choice : {-1, 2, INT32_MAX, INT32_MIN})
    EXPECT_FALSE(map->buttons(std::span(&choice, 1)).attack) << choice;
}

TEST(ActionMap, EveryButtonDoesItsOwnThing) {
  const auto map =
      ActionMap::create({{{"USE"}}, {{"JUMP"}}, {{"SPEED"}}, {{"SELECT_WEAPON3", "SELECT_WEAPON0"}}});
  ASSERT_TRUE(map);
  const doom::Buttons all = map->buttons(std::vector<int32_t>{1, 1, 1, 1});
  EXPECT_TRUE(all.use && all.jump && all.speed);
  EXPECT_EQ(all.select_weapon, 3);
  EXPECT_EQ(map->buttons(std::vector<int32_t>{0, 0, 0, 2}).select_weapon, 0);
  EXPECT_EQ(map->buttons(std::vector<int32_t>{0, 0, 0, 0}).select_weapon, -1);
}

TEST(ActionMap, RefusesAnUnknownButton) { EXPECT_FALSE(ActionMap::create({{{"DANCE"}}})); }

TEST(ActionMap, ADeltaButtonTurnsByItsNumber) {
  const auto map = ActionMap::create({{{"TURN_LEFT_RIGHT_DELTA=-10", "TURN_LEFT_RIGHT_DELTA=10"}}});
  ASSERT_TRUE(map) << map.error().message;
  const int32_t left = 1, right = 2;
  EXPECT_LT(map->buttons({&left, 1}).yaw_delta, 0);
  EXPECT_EQ(map->buttons({&right, 1}).yaw_delta, 1820);  // floor(10 * 32768 / 180)
  EXPECT_FALSE(ActionMap::create({{{"TURN_LEFT_RIGHT_DELTA"}}}));
}

}  // namespace action_map_test
}  // namespace comrad::sim
