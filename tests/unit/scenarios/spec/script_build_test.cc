#include "scenarios/spec/script_build.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/scratch_folder.h"

namespace comrad::scenarios {
namespace script_build_test {

using testing::AllOf;
using testing::HasSubstr;

constexpr const char* kLayout = "#define SIDE 512\n";
constexpr const char* kScript = "#include \"zcommon.acs\"\nscript 1 OPEN { cleared = SIDE; lost++; }\n";

class ScriptBuild : public testing::Test {
 protected:
  Expected<BuiltScript> build(const std::vector<ScenarioExport>& exports, const std::string& script,
                              const std::vector<std::string>& more = {}) {
    folder_.write("script.acs", script);
    ScenarioSpec spec;
    spec.folder = folder_.string();
    spec.exports = exports;
    return build_script(spec, kLayout, more);
  }
  std::string refusal(const std::vector<ScenarioExport>& exports, const std::string& script,
                      const std::vector<std::string>& more = {}) {
    const auto built = build(exports, script, more);
    return built ? "built" : built.error().message;
  }
  const test::ScratchFolder folder_;
};

TEST_F(ScriptBuild, ExportsAreTheScriptsGlobalVariables) {
  const std::vector<ScenarioExport> exports{{"cleared", 24, "bridges", 3}, {"lost", 5, "", 7}};
  const auto built = build(exports, kScript);
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ(built->source,
            std::string(kLayout) + "\nglobal int 24:cleared;  // bridges\nglobal int 5:lost;\n" + kScript);
  const auto by_hand = build({}, std::string("global int 24:cleared; global int 5:lost;\n") + kScript);
  ASSERT_TRUE(by_hand) << by_hand.error().message;
  EXPECT_EQ(built->behavior, by_hand->behavior);
}

TEST_F(ScriptBuild, MoreFilesComeBehindTheScriptAndSeeWhatItDeclares) {
  const std::vector<ScenarioExport> exports{{"cleared", 24, "", 3}, {"lost", 5, "", 7}};
  folder_.write("more.acs", "script 2 OPEN { cleared += SIDE; }\n");
  const auto built = build(exports, kScript, {"more.acs"});
  ASSERT_TRUE(built) << built.error().message;
  const auto by_hand = build(exports, std::string(kScript) + "script 2 OPEN { cleared += SIDE; }\n");
  ASSERT_TRUE(by_hand) << by_hand.error().message;
  EXPECT_EQ(built->behavior, by_hand->behavior);
  EXPECT_EQ(built->source, by_hand->source);
  folder_.write("more.acs", "script 2 OPEN { cleared += WIDTH; }\n");
  EXPECT_THAT(refusal(exports, kScript, {"more.acs"}), AllOf(HasSubstr("more.acs:1:"), HasSubstr("width")));
  EXPECT_THAT(refusal(exports, kScript, {"none.acs"}), HasSubstr("none.acs"));
}

TEST_F(ScriptBuild, MistakesNameTheFileAndLineOfTheirAuthor) {
  EXPECT_THAT(refusal({{"cleared", 24, "", 3}}, kScript),
              AllOf(HasSubstr("script.acs:2:"), HasSubstr("lost")));
  EXPECT_THAT(refusal({{"int", 1, "", 3}, {"cleared", 24, "", 4}, {"lost", 2, "", 5}}, kScript),
              HasSubstr("scenario.toml:3:"));
  EXPECT_THAT(refusal({{"cleared", 24, "", 3}, {"lost", 2, "", 5}}, std::string("int lost;\n") + kScript),
              AllOf(HasSubstr("second variable \"lost\""), HasSubstr("scenario.toml:5:")));
}

}  // namespace script_build_test
}  // namespace comrad::scenarios
