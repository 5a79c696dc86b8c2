#include "scenarios/spec/exported_variables.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/scratch_folder.h"

namespace comrad::scenarios {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;

TEST(DeclaredGlobals, AreReadWithNameAndComment) {
  const auto found = declared_globals(
      "// global int 9:in_a_comment;\n"
      "global int 24:cleared;          // J: bridges that both have behind them\n"
      "  Global Int 3 : second ;\r\n"
      "global bool 2:flag[];\n"
      "int 5:map_variable;\n"
      "global int 61:beyond;\nglobal int 0:before;\nglobal int 100:far;\n"
      "global int 7:last;");
  ASSERT_EQ(found.size(), 4u);
  EXPECT_EQ(found[0].user, 2);
  EXPECT_EQ(found[0].name, "flag");
  EXPECT_EQ(found[1].name, "second");
  EXPECT_EQ(found[1].meaning, "");
  EXPECT_EQ(found[2].name, "last");
  EXPECT_EQ(found[3].user, 24);
  EXPECT_EQ(found[3].name, "cleared");
  EXPECT_EQ(found[3].meaning, "J: bridges that both have behind them");
  EXPECT_THAT(declared_globals(""), IsEmpty());
  EXPECT_THAT(declared_globals(std::string(1 << 20, 'g')), IsEmpty());
}

TEST(ExportedVariables, SayWhatReadsThem) {
  const test::ScratchFolder folder;
  ScenarioSpec spec;
  spec.folder = folder.string();
  spec.score = "USER1";
  spec.score_divisor = "USER2";
  spec.measurements.resize(2);
  spec.measurements[0].variable = "HEALTH";
  spec.measurements[1].variable = "USER10";
  spec.measurements[1].agent_stride = 2;
  spec.rewards = {{.name = "find", .variable = "USER1", .kind = "rise", .when = "USER30", .unless = "DEAD"}};
  const auto without_script = exported_variables(spec, 3);
  ASSERT_TRUE(without_script);
  std::vector<int> users;
  for (const ExportedVariable& one : *without_script) users.push_back(one.user);
  EXPECT_THAT(users, ElementsAre(1, 2, 10, 12, 14, 30)) << "a stride of 2 for three agents";
  EXPECT_THAT((*without_script)[0].read_by, ElementsAre("score", "find"));
  EXPECT_THAT((*without_script)[3].read_by, ElementsAre("measurement 1"));
  EXPECT_EQ((*without_script)[0].name, "");

  folder.write("script.acs", "global int 1:found; // so far\nglobal int 40:unread;\n");
  const auto with_script = exported_variables(spec, 2);
  ASSERT_TRUE(with_script);
  EXPECT_EQ((*with_script)[0].name, "found");
  EXPECT_EQ((*with_script)[0].meaning, "so far");
  EXPECT_EQ(with_script->back().user, 40);
  EXPECT_THAT(with_script->back().read_by, IsEmpty());
}

}  // namespace
}  // namespace comrad::scenarios
