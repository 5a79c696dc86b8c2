#include "doomgen/wad/doom_specials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::wad {
namespace doom_specials_test {

using ::testing::ElementsAre;

struct Translation {
  UdmfLinedef line;
  std::optional<TranslatedLine> result;
};
Translation translate(int32_t type, int32_t tag) {
  Translation translation;
  translation.result = translate_doom_line(type, tag, translation.line);
  return translation;
}

TEST(DoomSpecials, EveryTypeOfDoomAndBoomIsKnown) {
  for (int32_t type = 1; type <= 269; ++type) {
    const Translation translation = translate(type, 5);
    ASSERT_TRUE(translation.result.has_value()) << type;
    EXPECT_GT(translation.result->special, 0) << type;
  }
  EXPECT_EQ(translate(0, 5).result->special, 0);
  EXPECT_FALSE(translate(270, 5).result.has_value());
  EXPECT_FALSE(translate(5000, 5).result.has_value());
  EXPECT_FALSE(translate(0x8000, 5).result.has_value());
}

TEST(DoomSpecials, ADoorByHandOpensWhatLiesBehindIt) {
  const Translation door = translate(1, 9);
  EXPECT_EQ(door.result->special, 12);
  EXPECT_THAT(door.result->args, ElementsAre(0, 16, 150, 0, 0));
  EXPECT_FALSE(door.result->uses_tag);
  EXPECT_TRUE(door.line.player_use && door.line.monster_use && door.line.repeat_special);
  EXPECT_FALSE(door.line.player_cross);
}

TEST(DoomSpecials, TriggersSayHowAndHowOften) {
  const Translation once = translate(2, 9), again = translate(86, 9), shot = translate(46, 9);
  EXPECT_THAT(once.result->args, ElementsAre(9, 16, 0, 0, 0));
  EXPECT_TRUE(once.result->uses_tag);
  EXPECT_TRUE(once.line.player_cross && !once.line.repeat_special && !once.line.monster_cross);
  EXPECT_TRUE(again.line.player_cross && again.line.repeat_special);
  EXPECT_TRUE(shot.line.impact && shot.line.monster_activate && shot.line.repeat_special);
  const Translation monsters_only = translate(126, 9);
  EXPECT_TRUE(monsters_only.line.monster_cross && !monsters_only.line.player_cross);
  EXPECT_THAT(monsters_only.result->args, ElementsAre(0, 9, 0, 0, 0));
}

TEST(DoomSpecials, GeneralizedTypesAreReadBitByBit) {
  // A fast locked door: pushed once, open and stay, blue card or skull.
  const Translation door = translate(0x3800 | 6 | 2 << 3 | 1 << 5 | 2 << 6 | 1 << 9, 4);
  EXPECT_EQ(door.result->special, 202);
  EXPECT_THAT(door.result->args, ElementsAre(0, 64, 1, 34, 130));
  EXPECT_TRUE(door.line.player_use && !door.line.repeat_special);
  // A turbo floor: switch again, up to the next floor, its texture by number, crushing.
  const Translation floor = translate(0x6000 | 3 | 3 << 3 | 1 << 5 | 1 << 6 | 2 << 7 | 2 << 10 | 1 << 12, 4);
  EXPECT_EQ(floor.result->special, 200);
  EXPECT_THAT(floor.result->args, ElementsAre(4, 64, 0, 3, 2 | 4 | 8 | 16));
  EXPECT_TRUE(floor.line.player_use && floor.line.repeat_special && !floor.line.monster_use);
  // A ceiling down by 32 that monsters may start by walking.
  const Translation ceiling = translate(0x4000 | 1 | 1 << 5 | 7 << 7, 4);
  EXPECT_THAT(ceiling.result->args, ElementsAre(4, 8, 32, 0, 0));
  EXPECT_TRUE(ceiling.line.monster_cross && ceiling.line.repeat_special);
  EXPECT_THAT(translate(0x3400 | 1 << 6 | 3 << 8, 4).result->args, ElementsAre(4, 16, 24, 4, 0));
  EXPECT_THAT(translate(0x3000 | 1 << 6 | 1 << 8, 4).result->args, ElementsAre(4, 2, 8, 1, 0));
  EXPECT_THAT(translate(0x2F80 | 1 << 3 | 1 << 6, 4).result->args, ElementsAre(4, 16, 16, 1, 10));
}

TEST(DoomSpecials, SectorTypesMoveToZDoomsNumbers) {
  EXPECT_EQ(translate_doom_sector(0), 0);
  EXPECT_EQ(translate_doom_sector(1), 65);
  EXPECT_EQ(translate_doom_sector(7), 71);
  EXPECT_EQ(translate_doom_sector(9), 0x400);
  EXPECT_EQ(translate_doom_sector(17), 81);
  EXPECT_EQ(translate_doom_sector(2 | 3 << 5 | 1 << 7 | 1 << 8), 66 | 0x300 | 0x400 | 0x800);
  EXPECT_EQ(translate_doom_sector(31), 0);
  EXPECT_EQ(translate_doom_sector(40000), 0);
}

}  // namespace doom_specials_test
}  // namespace comrad::wad
