#include "doomgen/wad/special_names.h"

#include <gtest/gtest.h>

#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace {

TEST(SpecialNames, AreFoundByNameInAnyCaseAndByNumber) {
  EXPECT_EQ(find_special("Door_Open"), 11);
  EXPECT_EQ(find_special("acs_EXECUTE"), 80);
  EXPECT_EQ(find_special("Exit_Normal"), 243);
  EXPECT_EQ(special_name(11), "Door_Open");
  EXPECT_EQ(special_name(226), "ACS_ExecuteAlways");
  EXPECT_FALSE(find_special("Door_Opens"));
  EXPECT_FALSE(find_special(""));
}

TEST(SpecialNames, NumbersWithoutASpecialHaveNoName) {
  for (const int32_t number : {-1, 0, 108, 255 + 26, INT32_MAX, INT32_MIN})
    EXPECT_EQ(special_name(number), "");
}

TEST(SpecialNames, RiseByNumberAndNoNameStandsTwice) {
  int32_t last = 0;
  for (const SpecialName& special : special_names()) {
    EXPECT_GT(special.number, last);
    last = special.number;
    EXPECT_EQ(find_special(lower_case(special.name)), special.number);
    EXPECT_EQ(special_name(special.number), special.name);
  }
  EXPECT_EQ(last, 280);
}

}  // namespace
}  // namespace comrad::wad
