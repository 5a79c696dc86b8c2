#include "scenarios/spec/game_names.h"

#include <gtest/gtest.h>

namespace comrad::scenarios {
namespace game_names_test {

TEST(GameNames, EveryListedNameIsFound) {
  for (const std::string& name : button_names()) EXPECT_TRUE(find_button(name)) << name;
  for (const std::string& name : variable_names()) EXPECT_TRUE(find_variable(name)) << name;
}

TEST(GameNames, NumbersAreReadAndBounded) {
  EXPECT_EQ(find_variable("USER60")->index, 60);
  EXPECT_EQ(find_button("SELECT_WEAPON7")->slot, 7);
  for (const char* name : {"USER0", "USER61", "USER01", "USER", "USER1X", "USER-1", "user1", ""})
    EXPECT_FALSE(find_variable(name)) << name;
  EXPECT_FALSE(find_button("SELECT_WEAPON10"));
}

TEST(GameNames, OnlyExportedVariablesBelongToTheTeam) {
  EXPECT_TRUE(find_variable("USER4")->is_team_variable());
  EXPECT_FALSE(find_variable("HEALTH")->is_team_variable());
}

TEST(GameNames, APressIsAButtonOrADeltaButtonWithItsNumber) {
  EXPECT_EQ(parse_press("ATTACK")->value, 1.0);
  EXPECT_EQ(parse_press("TURN_LEFT_RIGHT_DELTA=-2.5")->value, -2.5);
  EXPECT_EQ(parse_press("LOOK_UP_DOWN_DELTA=+4")->value, 4.0);
  for (const char* wrong : {"ATACK", "ATTACK=1", "TURN_LEFT_RIGHT_DELTA", "TURN_LEFT_RIGHT_DELTA=",
                            "TURN_LEFT_RIGHT_DELTA=nan", "TURN_LEFT_RIGHT_DELTA=1x", "", "="})
    EXPECT_FALSE(parse_press(wrong)) << wrong;
}

}  // namespace game_names_test
}  // namespace comrad::scenarios
