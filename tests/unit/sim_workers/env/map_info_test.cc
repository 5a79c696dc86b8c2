// The values are ViZDoom 1.3.2's: a WAD whose only class is Slow plays it, a map without jumps has none.
#include "sim_workers/env/map_info.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/env/game_content.h"
#include "tests/support/wad_bytes.h"

namespace comrad::sim {
namespace map_info_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

MapInfo info_of(const std::string& text, std::vector<std::string>* warnings) {
  MapInfo info;
  read_map_info(text, "w MAPINFO", "MAP01", &info, warnings);
  return info;
}

TEST(MapInfo, IsReadWithBracesAndInHexensForm) {
  for (const char* text :
       {"map MAP02 \"other\" { gravity = 1600 }\n"
        "map MAP01 \"The // Room\" { next = \"MAP02\" nojump gravity = 200 } // end\n",
        "defaultmap\nnocrouch\nallowcrouch\nmap map01 lookup HUSTR_1\nnext MAP02\nsky1 SKY1 0\nnojump\n"
        "gravity 200\nmap map02 \"other\"\ngravity 1600\nclusterdef 1\nexittext \"the end\"\n"}) {
    std::vector<std::string> warnings;
    const MapInfo info = info_of(text, &warnings);
    EXPECT_TRUE(info.rules.no_jump) << text;
    EXPECT_FALSE(info.rules.no_crouch);
    EXPECT_EQ(info.rules.gravity, doom::kFracUnit / 4);
    EXPECT_THAT(warnings, IsEmpty());
  }
}

TEST(MapInfo, WhatIsNotServedIsNamedOnce) {
  std::vector<std::string> warnings;
  const MapInfo info = info_of(
      "gameinfo { playerclasses = \"Slow\", \"Fast\" weaponslot = 1, \"Fist\" }\nskill hard { fastmonsters "
      "}\n"
      "map MAP01 \"x\" { monsterfallingdamage monsterfallingdamage }\n",
      &warnings);
  EXPECT_EQ(info.player_class, "Slow");
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("w MAPINFO: 'weaponslot'"), HasSubstr("'skill'"),
                                    HasSubstr("'monsterfallingdamage'")));
}

TEST(MapInfo, BrokenTextEndsSomewhere) {
  for (const char* text :
       {"map", "map MAP01", "map MAP01 \"x", "gameinfo {", "{ { {", "}", "map MAP01 { gravity = }",
        "gameinfo { playerclasses = , , }", "/* no end", "skill { { }"}) {
    std::vector<std::string> warnings;
    info_of(text, &warnings);
  }
}

TEST(KeyConf, NamesThePlayersClass) {
  MapInfo info;
  std::vector<std::string> warnings;
  read_key_conf("clearplayerclasses\naddplayerclass Slow nomenu\naddplayerclass Fast\nsetslot 1 Fist\n",
                "w KEYCONF", &info, &warnings);
  EXPECT_EQ(info.player_class, "slow");
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("setslot")));
}

TEST(MapInfo, AGameIsPlayedByIt) {
  constexpr const char* kSlow =
      "actor Slow : DoomPlayer { Speed 0.5 Health 50 Player.StartItem \"Shotgun\" Player.StartItem "
      "\"Shell\", 12 }\n";
  const auto content = [&](const std::string& lump, const std::string& text) {
    const auto wad = wad::WadFile::from_bytes(wad::test::WadBytes()
                                                  .add("DECORATE", kSlow)
                                                  .add(lump, text)
                                                  .add("MAP01")
                                                  .add("TEXTMAP", wad::test::square_room_text())
                                                  .add("ENDMAP")
                                                  .build(),
                                              "t.wad");
    const Expected<GameContent> loaded = load_game_content(*wad);
    EXPECT_TRUE(loaded) << loaded.error().message;
    return *loaded;
  };
  for (const GameContent& game : {content("MAPINFO", "gameinfo { playerclasses = \"Slow\" }"),
                                  content("KEYCONF", "clearplayerclasses\naddplayerclass Slow\n")}) {
    doom::World world(game.level, game.catalog);
    reset_world(world, {});
    EXPECT_EQ(world.player(0).health, 50);
    EXPECT_EQ(world.body_of(0)->speed, doom::kFracUnit / 2);
  }
  const GameContent heavy = content("MAPINFO", "map MAP01 \"x\" { nojump gravity = 1600 }");
  doom::World world(heavy.level, heavy.catalog);
  reset_world(world, {});
  EXPECT_FALSE(world.options().allow_jump);
  EXPECT_EQ(world.state().gravity, 2 * doom::kFracUnit);
  EXPECT_THAT(content("KEYCONF", "addplayerclass Nowhere\n").warnings,
              ElementsAre(HasSubstr("'nowhere' is no PlayerPawn")));
}

}  // namespace map_info_test
}  // namespace comrad::sim
