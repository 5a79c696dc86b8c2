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
  ASSERT_NE(alone->behavior, nullptr) << "a map without scripts of its own";
  EXPECT_NE(alone->behavior->find_script(77), nullptr);
}

}  // namespace game_content_test
}  // namespace comrad::sim
