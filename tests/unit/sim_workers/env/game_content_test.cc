// What a WAD brings besides its map: included DECORATE lumps, and script libraries.
#include "sim_workers/env/game_content.h"

#include <gtest/gtest.h>

#include "doomgen/acs/compiler.h"
#include "tests/support/wad_bytes.h"

namespace comrad::sim {
namespace game_content_test {

std::string compiled(const std::string& source) {
  const auto script = acs_compiler::compile(source, "test.acs");
  EXPECT_TRUE(script.has_value()) << (script ? "" : script.error().message);
  return script ? std::string(script->behavior.begin(), script->behavior.end()) : std::string();
}

Expected<GameContent> load(const wad::test::WadBytes& bytes) {
  const auto wad = wad::WadFile::from_bytes(bytes.build(), "test.wad");
  if (!wad) return wad.error();
  return load_game_content(*wad);
}

wad::test::WadBytes room() {
  wad::test::WadBytes wad;
  wad.add("MAP01").add("TEXTMAP", wad::test::square_room_text());
  return wad;
}

TEST(GameContent, ReadsIncludedLumps) {
  const auto content =
      load(room()
               .add("ENDMAP")
               .add("DECORATE", "#include \"ITEMS\"\nactor Last : Prize { }\n#include \"gone.txt\"\n")
               .add("ITEMS", "actor Prize : Health 12340 { }"));
  ASSERT_TRUE(content.has_value()) << content.error().message;
  EXPECT_TRUE(content->catalog->find_editor_number(12340).has_value());
  ASSERT_EQ(content->warnings.size(), 1u);
  EXPECT_EQ(content->warnings[0],
            "test.wad DECORATE:3: #include \"gone.txt\": there is no such lump; its actors are left out");
}

TEST(GameContent, APatchIsOneWarningThatNamesItsKinds) {
  const std::string looks =
      "Patch File for DeHackEd v3.0\r\nDoom version = 21\r\n\r\nFrame 185\r\nSprite subnumber = 32773\r\n"
      "[STRINGS]\r\nHUSTR_1 = Text 5 of a sentence\r\n";
  const auto silent = load(room().add("ENDMAP").add("DEHACKED", looks));
  ASSERT_TRUE(silent.has_value()) << silent.error().message;
  EXPECT_TRUE(silent->warnings.empty()) << silent->warnings.front();
  const auto content = load(room().add("ENDMAP").add(
      "DEHACKED",
      looks + "Thing 1 (Player)\r\nHit points = 50\r\nThing 2\r\nSpeed = 9\r\nFrame 7\r\nDuration = 3\r\n"));
  ASSERT_TRUE(content.has_value()) << content.error().message;
  ASSERT_EQ(content->warnings.size(), 1u);
  EXPECT_EQ(content->warnings[0],
            "test.wad DEHACKED: patches are not supported; these blocks are left out: Frame, Thing");
}

TEST(GameContent, LoadsTheLibrariesOfLoadacs) {
  const std::string library = compiled("#library \"extra\"\nscript 77 OPEN { } script \"Helper\" (void) { }");
  const auto content = load(room()
                                .add("BEHAVIOR", compiled("script 1 OPEN { }"))
                                .add("ENDMAP")
                                .add("A_START")
                                .add("EXTRA", library)
                                .add("A_END")
                                .add("LOADACS", "// of the whole game\r\nextra absent // two in a line\n"));
  ASSERT_TRUE(content.has_value()) << content.error().message;
  ASSERT_NE(content->behavior, nullptr);
  EXPECT_EQ(content->behavior->scripts().size(), 3u);
  EXPECT_NE(content->behavior->find_script("helper"), nullptr);

  const auto alone = load(room().add("ENDMAP").add("EXTRA", library).add("LOADACS", "EXTRA"));
  ASSERT_TRUE(alone.has_value()) << alone.error().message;
  ASSERT_NE(alone->behavior, nullptr) << "a map without scripts";
  EXPECT_NE(alone->behavior->find_script(77), nullptr);
}

}  // namespace game_content_test
}  // namespace comrad::sim
