#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/recipes.h"
#include "rollout_buffer/settings/run_config.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace loader_test {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

constexpr const char* kGood = R"(name = "toy"
title = "Toy"
summary = "A toy."
difficulty = 1
default_agents = 2
supported_agents = [2, 3]
decision_limit = 100
score = "survival_tics"
ceiling = 400
[[heads]]
buttons = ["MOVE_FORWARD", "MOVE_BACKWARD"]
[[heads]]
buttons = ["ATTACK"]
[[measurements]]
variable = "USER7"
scale = 0.5
[[rewards]]
name = "life"
variable = "HEALTH"
kind = "rise"
weight = 0.1
[training.small.ippo]
batch_size = 1024
learning_rate = 3e-4
async_rl = false
)";

/// Points data_dir() at its own folder with the scenario "toy".
class ScenarioLoader : public testing::Test {
 protected:
  void SetUp() override {
    const char* home = std::getenv("COMRAD_HOME");
    old_home_ = home != nullptr ? home : "";
    folder_ = std::filesystem::path(testing::TempDir()) / ("comrad_loader_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_ / "scenarios" / "toy");
    setenv("COMRAD_HOME", folder_.c_str(), 1);
  }
  void TearDown() override {
    std::filesystem::remove_all(folder_);
    if (old_home_.empty())
      unsetenv("COMRAD_HOME");
    else
      setenv("COMRAD_HOME", old_home_.c_str(), 1);
  }
  Expected<ScenarioSpec> load(const std::string& text) {
    std::ofstream(folder_ / "scenarios" / "toy" / "scenario.toml") << text;
    return load_scenario("toy");
  }
  /// kGood with one piece replaced.
  Expected<ScenarioSpec> load_with(const std::string& from, const std::string& to) {
    std::string text = kGood;
    const std::size_t place = text.find(from);
    EXPECT_NE(place, std::string::npos) << from;
    return load(text.replace(place, from.size(), to));
  }
  std::string message(const Expected<ScenarioSpec>& result) {
    EXPECT_FALSE(result) << "should have failed";
    return result ? "" : result.error().message;
  }

  std::filesystem::path folder_;
  std::string old_home_;
};

TEST_F(ScenarioLoader, ReadsEverything) {
  const auto spec = load(kGood);
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->title, "Toy");
  EXPECT_THAT(spec->supported_agents, ElementsAre(2, 3));
  EXPECT_EQ(spec->decision_limit, 100);
  EXPECT_EQ(spec->rewards.size(), 1u);
  EXPECT_EQ(spec->rewards[0].scope, "own");
  EXPECT_EQ(spec->measurements[0].scale, 0.5);
  ASSERT_EQ(spec->training.values.size(), 3u);
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, scenario_settings(spec->training, Preset::kSmall, "ippo")));
  EXPECT_EQ(config.optimisation.batch_size, 1024);
  EXPECT_EQ(config.optimisation.learning_rate, 3e-4);
  EXPECT_FALSE(config.collection.async_rl);
  const EnvShape shape = spec->shape(3, true);
  EXPECT_EQ(shape.num_agents, 3);
  EXPECT_EQ(shape.head_count, 2);
  EXPECT_EQ(shape.head_sizes[0], 3);
  EXPECT_EQ(shape.head_sizes[1], 2);
  EXPECT_EQ(shape.measurement_count, 1);
  EXPECT_EQ(spec->shape(3, false).measurement_count, 0);
}

TEST_F(ScenarioLoader, SettingsAreInATableOfTheirPresetAndAlgorithm) {
  const auto spec = load(std::string(kGood) + "[training.paper.DQN]\nrollout = 16\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(spec->training.values, Contains(Pair("paper.idqn.rollout", "16")));
  EXPECT_THAT(spec->training.values, Contains(Pair("small.ippo.batch_size", "1024")));
}

TEST_F(ScenarioLoader, ATableMayNameAGroupOfAlgorithms) {
  const auto spec = load(std::string(kGood) +
                         "[training.small.q_learning]\nrollout = 16\n[training.small.all]\ngamma = 0.9\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(spec->training.values, Contains(Pair("small.q_learning.rollout", "16")));
  RunConfig config;
  ASSERT_TRUE(apply_layer(config, scenario_settings(spec->training, Preset::kSmall, "vdn")));
  EXPECT_EQ(config.collection.rollout, 16);
  EXPECT_EQ(config.optimisation.gamma, 0.9);
}

TEST_F(ScenarioLoader, ASettingWithoutAnAlgorithmIsRefusedWithItsPlace) {
  const auto refusal = [this](const std::string& tables) {
    return message(load(std::string(kGood) + tables));
  };
  EXPECT_THAT(refusal("[training]\nbatch_size = 512\n"),
              AllOf(HasSubstr("scenario.toml:27:1: unknown preset 'batch_size'"),
                    HasSubstr("[training.small.ippo]")));
  EXPECT_THAT(
      refusal("[training.vdn]\nrollout = 16\n"),
      AllOf(HasSubstr(":26:"), HasSubstr("unknown preset 'vdn'"), HasSubstr("[training.small.ippo]")));
  EXPECT_THAT(
      refusal("[training.small]\nrollout = 16\n"),
      AllOf(HasSubstr("27:1"), HasSubstr("unknown algorithm 'rollout'"), HasSubstr("[training.small.ippo]")));
  EXPECT_THAT(refusal("[training.small]\nvdn = 16\n"), HasSubstr("'training.small.vdn' is no table"));
  EXPECT_THAT(refusal("[training]\npaper = 16\n"), HasSubstr("'training.paper' is no table"));
  EXPECT_THAT(refusal("[training.smal.vdn]\nrollout = 16\n"), HasSubstr("did you mean 'small'"));
  EXPECT_THAT(refusal("[training.small.vnd]\nrollout = 16\n"), HasSubstr("did you mean 'vdn'"));
  EXPECT_THAT(refusal("[training.small.vdn]\nrolout = 16\n"),
              AllOf(HasSubstr("27:1"), HasSubstr("'rollout'")));
  EXPECT_THAT(refusal("[training.small.vdn]\nrollout = \"long\"\n"), HasSubstr("it must be a whole number"));
  EXPECT_THAT(refusal("[training.small.vdn]\nalgo = \"qmix\"\n"), HasSubstr("'algo' chooses the recipe"));
}

TEST_F(ScenarioLoader, UnknownKeysNameTheNearestOneAndTheirPlace) {
  EXPECT_THAT(
      message(load_with("decision_limit", "decision_limt = 1\ndecision_limit")),
      AllOf(HasSubstr("scenario.toml:7:1"), HasSubstr("'decision_limt'"), HasSubstr("'decision_limit'")));
  EXPECT_THAT(message(load_with("scale = 0.5", "scael = 0.5")),
              AllOf(HasSubstr("16:1"), HasSubstr("'scale'")));
  EXPECT_THAT(message(load_with("kind = \"rise\"", "kind = \"rise\"\nweigth = 1")), HasSubstr("'weight'"));
}

TEST_F(ScenarioLoader, AMisspeltKeyThatIsRequiredIsNamedAtItsOwnPlace) {
  const auto refusal = [this](const std::string& from, const std::string& to) {
    return message(load_with(from, to));
  };
  EXPECT_THAT(refusal("title =", "titel ="),
              HasSubstr("scenario.toml:2:1: unknown key 'titel'; did you mean 'title'?"));
  EXPECT_THAT(
      refusal("supported_agents", "suported_agents"),
      HasSubstr("scenario.toml:6:1: unknown key 'suported_agents'; did you mean 'supported_agents'?"));
  EXPECT_THAT(refusal("score =", "scores ="), HasSubstr(":8:1: unknown key 'scores'; did you mean 'score'?"))
      << "rather than score_scale";
  EXPECT_THAT(refusal("buttons = [\"ATTACK\"]", "button = [\"ATTACK\"]"),
              HasSubstr("scenario.toml:13:1: unknown key 'button'; did you mean 'buttons'?"));
  EXPECT_THAT(refusal("weight = 0.1", "wieght = 0.1"),
              HasSubstr(":21:1: unknown key 'wieght'; did you mean 'weight'?"));
  EXPECT_THAT(refusal("variable = \"USER7\"", "varable = \"USER7\""),
              HasSubstr(":15:1: unknown key 'varable'; did you mean 'variable'?"));
  std::string text = kGood;
  for (std::size_t at; (at = text.find("[[heads]]")) != std::string::npos;) text.replace(at, 9, "[[head]]");
  EXPECT_THAT(message(load(text)), AllOf(HasSubstr(":10:"), HasSubstr("did you mean 'heads'?")));
  EXPECT_THAT(refusal("title = \"Toy\"\n", ""), HasSubstr("'title' is missing"));
}

TEST_F(ScenarioLoader, WhatBelongsToAScoreThatIsAVariableIsRefusedElsewhere) {
  for (const char* score : {"survival_tics", "return"})
    for (const auto& [key, value] : std::vector<std::pair<std::string, std::string>>{
             {"score_divisor", "\"USER2\""}, {"score_scale", "0.5"}, {"score_agent_stride", "0"}})
      EXPECT_THAT(message(load_with("score = \"survival_tics\"",
                                    "score = \"" + std::string(score) + "\"\n" + key + " = " + value)),
                  AllOf(HasSubstr("scenario.toml:9:"), HasSubstr("'" + key + "' must be left out"),
                        HasSubstr(score), HasSubstr("game variable")));
  const auto divided = load_with("score = \"survival_tics\"", "score = \"USER1\"\nscore_divisor = \"USER2\"");
  ASSERT_TRUE(divided) << divided.error().message;
  EXPECT_EQ(divided->score_divisor, "USER2");
}

TEST_F(ScenarioLoader, UnknownWordsNameTheNearestOneAndTheirPlace) {
  EXPECT_THAT(message(load_with("\"rise\"", "\"rises\"")),
              AllOf(HasSubstr("20:"), HasSubstr("did you mean 'rise'")));
  EXPECT_THAT(message(load_with("HEALTH", "HEALHT")), HasSubstr("did you mean 'HEALTH'"));
  EXPECT_THAT(message(load_with("MOVE_FORWARD", "MOVE_FORWRD")),
              AllOf(HasSubstr("11:"), HasSubstr("'MOVE_FORWARD'")));
  EXPECT_THAT(message(load_with("USER7", "USER77")), HasSubstr("unknown"));
}

constexpr const char* kExports = R"([exports]
found = 7       # kits, so far
found_2 = 8
left_over = 60
)";

TEST_F(ScenarioLoader, ExportsNameUserVariables) {
  const std::string with_exports =
      std::string(kExports) +
      "[[rewards]]\nname = \"kit\"\nvariable = \"found\"\nagent_stride = 1\nkind = \"rise\"\nweight = 1.0\n"
      "when = \"left_over\"\nunless = \"found_2\"\n[[heads]]";
  const auto two_agents = [&](std::string text) {
    text.replace(text.find("[[heads]]"), 9, with_exports);
    text.replace(text.find("[2, 3]"), 6, "[2]");
    text.replace(text.find("\"USER7\""), 7, "\"found_2\"");
    return text.replace(text.find("\"survival_tics\""), 15, "\"left_over\"\nscore_divisor = \"found\"");
  };
  const auto spec = load(two_agents(kGood));
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->score, "USER60");
  EXPECT_EQ(spec->score_divisor, "USER7");
  EXPECT_EQ(spec->measurements[0].variable, "USER8");
  EXPECT_EQ(spec->rewards[0].variable, "USER7");
  EXPECT_EQ(spec->rewards[0].when, "USER60");
  EXPECT_EQ(spec->rewards[0].unless, "USER8");
  ASSERT_EQ(spec->exports.size(), 3u);
  EXPECT_EQ(spec->exports[0].name, "found");
  EXPECT_EQ(spec->exports[0].user, 7);
  EXPECT_EQ(spec->exports[0].meaning, "kits, so far");
  EXPECT_EQ(spec->exports[0].line, 12);
  EXPECT_EQ(spec->exports[1].meaning, "");
  EXPECT_EQ(*spec->user_number("found_2"), 8);
  EXPECT_THAT(*spec->user_numbers({"left_over", "found"}), ElementsAre(60, 7));
  EXPECT_THAT(
      spec->user_numbers({"found", "left_ovr"}).error().message,
      AllOf(HasSubstr("scenario.toml"), HasSubstr("did you mean 'left_over'?"), HasSubstr("[exports]")));
}

TEST_F(ScenarioLoader, ExportsThatCannotBeMeantAreRefusedAtTheirPlace) {
  const auto refusal = [this](const std::string& rows, const std::string& variable = "USER7") {
    std::string text = kGood;
    text.replace(text.find("\"USER7\""), 7, "\"" + variable + "\"");
    text.replace(text.find("[[heads]]"), 9, "[exports]\n" + rows + "[[heads]]");
    return message(load(text));
  };
  EXPECT_THAT(refusal("found = 7\n", "fuond"),
              AllOf(HasSubstr("scenario.toml:17:12"), HasSubstr("did you mean 'found'?")));
  EXPECT_THAT(
      refusal("found = 7\ngone = 8\nlost = 7\n"),
      AllOf(HasSubstr("scenario.toml:13:8"), HasSubstr("'lost' is USER7"), HasSubstr("'found' in line 11")));
  EXPECT_THAT(refusal("found = 7\nfound = 8\n"), AllOf(HasSubstr("scenario.toml:12:"), HasSubstr("found")));
  for (const char* number : {"0", "61", "-1", "1.0", "\"7\"", "99999999999"})
    EXPECT_THAT(refusal("found = " + std::string(number) + "\n"),
                AllOf(HasSubstr("scenario.toml:11:9"), HasSubstr("'found' must be a whole number in 1..60")));
  for (const char* name :
       {"HEALTH", "Found", "2nd", "_found", "a-b", "return", "survival_tics", "\"\"", "\"a b\""})
    EXPECT_THAT(refusal(std::string(name) + " = 7\n"),
                AllOf(HasSubstr("scenario.toml:11:1"), HasSubstr("small letters")));
  EXPECT_THAT(message(load_with("[[heads]]", "[exprots]\nfound = 7\n[[heads]]")),
              HasSubstr("did you mean 'exports'?"));
  EXPECT_THAT(message(load_with("decision_limit", "exports = 5\ndecision_limit")),
              HasSubstr("'exports' is no table"));
  EXPECT_THAT(
      message(load_with("[[heads]]", std::string(kExports) +
                                         "[[rewards]]\nname = \"kit\"\nvariable = \"found\"\n"
                                         "agent_stride = 1\nkind = \"rise\"\nweight = 1.0\n[[heads]]")),
      AllOf(HasSubstr("agent_stride"), HasSubstr("[exports] has no USER9")))
      << "the third agent's";
}

TEST_F(ScenarioLoader, WrongTypesAndMissingKeysAreErrors) {
  EXPECT_THAT(message(load_with("difficulty = 1", "difficulty = 1.5")), HasSubstr("whole number"));
  EXPECT_THAT(message(load_with("difficulty = 1", "")), HasSubstr("'difficulty' is missing"));
  EXPECT_THAT(message(load_with("weight = 0.1", "weight = nan")), HasSubstr("must be a number"));
  EXPECT_THAT(message(load_with("weight = 0.1", "")), HasSubstr("'weight' is missing"));
  EXPECT_THAT(message(load_with("[2, 3]", "[3]")), HasSubstr("default_agents"));
  EXPECT_THAT(message(load_with("[2, 3]", "[2, 9]")), HasSubstr("supported_agents"));
  EXPECT_THAT(message(load_with("\"toy\"", "\"tot\"")), HasSubstr("'toy'"));
  EXPECT_THAT(message(load_with("survival_tics", "survival")), HasSubstr("score"));
}

TEST_F(ScenarioLoader, TrainingSettingsAreCheckedHere) {
  EXPECT_THAT(message(load_with("batch_size", "batch_sise")),
              AllOf(HasSubstr("23:1"), HasSubstr("batch_size")));
  EXPECT_THAT(message(load_with("async_rl = false", "async_rl = 17")), HasSubstr("async_rl"));
}

TEST_F(ScenarioLoader, BrokenTomlNamesTheLine) {
  EXPECT_THAT(message(load("name = \"toy\"\ntitle = \n")), HasSubstr("scenario.toml:2:"));
}

TEST_F(ScenarioLoader, AnUnknownScenarioListsTheKnownOnes) {
  ASSERT_TRUE(load(kGood));
  const auto missing = load_scenario("tyo");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(missing.error().message, HasSubstr("toy"));
  EXPECT_FALSE(load_scenario("../toy"));
  EXPECT_THAT(list_scenarios(), ElementsAre("toy"));
}

TEST(ScenarioFiles, EveryScenarioOfTheProjectLoads) {
  const std::vector<std::string> names = list_scenarios();
  EXPECT_THAT(names, testing::Contains("coop_health_gathering"));
  for (const std::string& name : names) {
    const auto spec = load_scenario(name);
    EXPECT_TRUE(spec) << spec.error().message;
  }
}

TEST(ScenarioFiles, CoopHealthGatheringIsAsPublished) {
  const auto spec = load_scenario("coop_health_gathering");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->shape(2, false).joint_action_count(), 27);
  EXPECT_THAT(spec->heads[0].buttons, ElementsAre("MOVE_FORWARD", "MOVE_BACKWARD"));
  EXPECT_THAT(spec->heads[1].buttons, ElementsAre("MOVE_RIGHT", "MOVE_LEFT"));
  EXPECT_THAT(spec->heads[2].buttons, ElementsAre("TURN_LEFT", "TURN_RIGHT"));
  EXPECT_EQ(spec->decision_limit, 2100);
  EXPECT_EQ(spec->ceiling, 4.0 * spec->decision_limit);
  EXPECT_EQ(spec->shared_reward_alpha, 0.0);
}

}  // namespace loader_test
}  // namespace comrad::scenarios
