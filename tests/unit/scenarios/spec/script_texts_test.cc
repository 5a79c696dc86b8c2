// Texts of the scenarios' scripts.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace script_texts_test {

// A bar made of `|` was the only cue of a load and could not be seen in ViZDoom, whose small font ends at the
// underscore; small letters are drawn as capitals.
TEST(ScriptTexts, UseLettersThatTheSmallFontHas) {
  int files = 0;
  for (const auto& folder :
       std::filesystem::directory_iterator(std::string(COMRAD_SOURCE_DIR) + "/scenarios")) {
    std::ifstream file(folder.path() / "script.acs");
    if (!file) continue;
    ++files;
    bool quoted = false;
    int line = 1;
    for (std::istreambuf_iterator<char> at(file), end; at != end; ++at) {
      if (*at == '\n') ++line, quoted = false;
      if (*at == '"') quoted = !quoted;
      if (quoted && (*at == '|' || *at == '{' || *at == '}' || *at == '~' || *at == '`'))
        ADD_FAILURE() << folder.path() << ", line " << line << ": ViZDoom draws nothing for " << *at;
    }
  }
  EXPECT_GE(files, 13);
}

TEST(ScriptTexts, DeclareNoGlobalVariableThatExportsHave) {
  for (const std::string& name : list_scenarios()) {
    const auto spec = load_scenario(name);
    ASSERT_TRUE(spec) << spec.error().message;
    EXPECT_FALSE(spec->exports.empty()) << name;
    const auto script = read_scenario_file(spec->folder + "/script.acs");
    ASSERT_TRUE(script) << script.error().message;
    // A switch of a variant, which [globals] sets, is none of the scenario's exports: critics would see it.
    for (std::size_t at = 0; (at = script->find("\nglobal ", at)) != std::string::npos; ++at)
      EXPECT_EQ(std::ranges::count(spec->exports,
                                   std::atoi(script->c_str() + script->find_first_of("0123456789", at)),
                                   &ScenarioExport::user),
                0)
          << name << ": [exports] of scenario.toml declares them";
  }
}

}  // namespace script_texts_test
}  // namespace comrad::scenarios
