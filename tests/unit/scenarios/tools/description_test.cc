// What `comrad scenarios describe` states, beside what the scenarios' files say.
#include "scenarios/tools/description.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"
#include "tests/support/scratch_folder.h"

namespace comrad::scenarios {
namespace description_test {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST(Describe, HasEveryTermOfEveryScenario) {
  for (const std::string& name : list_scenarios()) {
    const auto spec = load_scenario(name);
    ASSERT_TRUE(spec) << spec.error().message;
    const auto described = describe(name, 0);
    ASSERT_TRUE(described) << described.error().message;
    EXPECT_EQ((*described)["measurements"], spec->measurements.size()) << name;
    EXPECT_EQ((*described)["global_state_names"].size(), (*described)["global_state"]) << name;
    EXPECT_EQ((*described)["global_state"],
              10 * (*described)["num_agents"].get<std::size_t>() + (*described)["exported_variables"].size())
        << name;
    EXPECT_EQ((*described)["measurement_terms"].size(), spec->measurements.size()) << name;
    EXPECT_EQ((*described)["rewards"].size(), spec->rewards.size()) << name;
    EXPECT_EQ((*described)["masks"].size(), spec->masks.size()) << name;
    const auto parameters = layout_parameters(name);
    ASSERT_TRUE(parameters) << parameters.error().message;
    EXPECT_EQ((*described)["layout_parameters"].size(), parameters->size()) << name;
    const std::string text = description_text(*described);
    for (const RewardTerm& term : spec->rewards) EXPECT_THAT(text, HasSubstr(term.name)) << name;
    for (const LayoutParameter& one : *parameters) EXPECT_THAT(text, HasSubstr(one.help)) << name;
    if (spec->score.starts_with("USER")) {
      bool is_there = false;
      for (const auto& one : (*described)["exported_variables"])
        is_there |= one["variable"] == spec->score && one["name"] != "" && one["read_by"][0] == "score";
      EXPECT_TRUE(is_there) << name << ": " << spec->score;
    }
  }
}

TEST(Describe, ExplainsATerm) {
  const test::ScratchFolder home;
  home.write("toy/scenario.toml", R"(name = "toy"
title = "Toy"
summary = "A toy."
difficulty = 1
default_agents = 2
supported_agents = [2, 3]
decision_limit = 100
wad = "map.wad"
score = "USER1"
score_scale = 0.5
score_divisor = "USER2"
ceiling = 40
[[heads]]
buttons = ["MOVE_FORWARD"]
[[masks]]
agent = 1
head = 0
allowed = ["none"]
[[measurements]]
variable = "USER10"
agent_stride = 2
scale = 0.25
high = 3.5
[[rewards]]
name = "find"  # of anything
variable = "HEALTH"
kind = "rise"
weight = 0.1
scope = "team"
per_agent = true
when = "TRUNCATED"
[training.small.ippo]
gamma = 0.999
)");
  const auto described = describe((home / "toy").string(), 3);
  ASSERT_TRUE(described) << described.error().message;
  EXPECT_EQ((*described)["measurements"], 1);
  EXPECT_EQ((*described)["measurement_terms"][0]["high"], 3.5);
  EXPECT_TRUE((*described)["measurement_terms"][0]["low"].is_null());
  EXPECT_EQ((*described)["rewards"][0]["when"], "TRUNCATED");
  EXPECT_EQ((*described)["rewards"][0]["meaning"], "of anything");
  EXPECT_EQ((*described)["observation"]["crosshair"], false);
  EXPECT_EQ((*described)["masks"][0]["allowed"][0], "none");
  EXPECT_EQ((*described)["exported_variables"].size(), 5u) << "USER1, USER2, USER10, USER12, USER14";
  EXPECT_THAT(
      description_text(*described),
      AllOf(HasSubstr("USER1 x 0.5 / USER2 (unit: share), ceiling 40"),
            HasSubstr("agents          3 (it supports 2, 3)"), HasSubstr("agent 1  head 0  none"),
            HasSubstr("USER10 + 2 for each agent  x 0.25"), HasSubstr("at most 3.5"),
            HasSubstr("find  0.1  rise  HEALTH  of the team, divided by the agents, when TRUNCATED"),
            HasSubstr("small.ippo.gamma  0.999"), HasSubstr("map.wad"), Not(HasSubstr("Layout parameters"))));
  EXPECT_THAT(describe((home / "toy").string(), 4).error().message, HasSubstr("num_agents may be 2, 3"));
}

}  // namespace description_test
}  // namespace comrad::scenarios
