#include "deploy/settings/scenario_description.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace scenario_description_test {

using ::testing::HasSubstr;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

const std::string kGood = R"({"name":"two_rooms","title":"Two Rooms","num_agents":2,"supported_agents":[2,4],
  "heads":[3,4],"head_buttons":[["A","B"],["C","D","E"]],"measurements":7,"global_state":25,"decision_limit":2100,"ceiling":8400,
  "shared_reward_alpha":0.5,"score":"survival_tics","score_unit":"tics","version":3,"rewards":[{"name":"own_death"},{"name":"kit_taken"}],"training":{"small.ippo.batch_size":"1024","paper.vdn.gamma":0.9}})";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

TEST(ParseDescription, ReadsEveryField) {
  const auto scenario = parse_description(kGood);
  ASSERT_TRUE(scenario) << scenario.error().message;
  EXPECT_EQ(scenario->name, "two_rooms");
  EXPECT_EQ(scenario->env.num_agents, 2);
  EXPECT_EQ(scenario->env.head_count, 2);
  EXPECT_EQ(scenario->env.head_sizes[1], 4);
  EXPECT_EQ(scenario->env.measurement_count, 7);
  EXPECT_EQ(scenario->env.global_state_count, 25);
  EXPECT_EQ(scenario->decision_limit, 2100);
  EXPECT_EQ(scenario->version, 3);
  EXPECT_EQ(scenario->score_unit, "tics");
  EXPECT_EQ(scenario->ceiling, 8400);
  EXPECT_EQ(scenario->shared_reward_alpha, 0.5);
  EXPECT_THAT(scenario->rewards, testing::ElementsAre("own_death", "kit_taken"));
  EXPECT_EQ(scenario->training.origin, "scenario two_rooms");
  EXPECT_THAT(scenario->training.values,
              UnorderedElementsAre(Pair("small.ippo.batch_size", "1024"), Pair("paper.vdn.gamma", "0.9")));
}

TEST(ParseDescription, NamesTheKeyThatIsMissingOrOfTheWrongType) {
  for (const auto& [from, to, key] : std::vector<std::array<std::string, 3>>{
           {R"("ceiling":8400,)", "", "ceiling"},
           {R"("num_agents":2)", R"("num_agents":"two")", "num_agents"},
           {R"("supported_agents":[2,4])", R"("supported_agents":[2,"x"])", "supported_agents"},
           {R"("heads":[3,4])", R"("heads":[])", "heads"},
           {R"("heads":[3,4])", R"("heads":[3,3,3,3,3,3,3,3,3])", "heads"},
           {R"("rewards":[{"name":"own_death"})", R"("rewards":[{"title":"own_death"})", "name"},
           {R"("training":{)", R"("training":[{)", "output"}}) {
    const auto scenario = parse_description(replaced(kGood, from, to));
    ASSERT_FALSE(scenario) << to;
    EXPECT_EQ(scenario.error().code, ErrorCode::kBadFormat);
    EXPECT_THAT(scenario.error().message, HasSubstr(key));
  }
}

TEST(ParseDescription, RefusesWhatIsNoJson) {
  for (const char* text : {"", "[]", "{", "null", "\xff\xfe"}) EXPECT_FALSE(parse_description(text)) << text;
}

}  // namespace scenario_description_test
}  // namespace comrad::deploy
