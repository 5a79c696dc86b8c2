#include "scenarios/spec/exported_variables.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::scenarios {
namespace exported_variables_test {

using testing::ElementsAre;
using testing::IsEmpty;

TEST(ExportedVariables, SayWhatReadsThem) {
  ScenarioSpec spec;
  spec.score = "USER1";
  spec.score_divisor = "USER2";
  spec.measurements.resize(2);
  spec.measurements[0].variable = "HEALTH";
  spec.measurements[1].variable = "USER10";
  spec.measurements[1].agent_stride = 2;
  spec.rewards = {{.name = "find", .variable = "USER1", .kind = "rise", .when = "USER30", .unless = "DEAD"}};
  const auto unnamed = exported_variables(spec, 3);
  std::vector<int> users;
  for (const ExportedVariable& one : unnamed) users.push_back(one.user);
  EXPECT_THAT(users, ElementsAre(1, 2, 10, 12, 14, 30)) << "a stride of 2 for three agents";
  EXPECT_THAT(unnamed[0].read_by, ElementsAre("score", "find"));
  EXPECT_THAT(unnamed[3].read_by, ElementsAre("measurement 1"));
  EXPECT_EQ(unnamed[0].name, "");

  spec.exports = {{"unread", 40, "", 8}, {"found", 1, "so far", 9}};
  const auto named = exported_variables(spec, 2);
  EXPECT_EQ(named[0].name, "found");
  EXPECT_EQ(named[0].meaning, "so far");
  EXPECT_THAT(named[0].read_by, ElementsAre("score", "find"));
  EXPECT_EQ(named.back().user, 40);
  EXPECT_THAT(named.back().read_by, IsEmpty());
}

}  // namespace exported_variables_test
}  // namespace comrad::scenarios
