#include "deploy/settings/command_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "rollout_buffer/settings/algorithms.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace command_line_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

using Words = std::vector<std::string>;

/// A command with all settings, parsed; the error message or "".
std::string parse(CommandLine& line, const Words& words) {
  line.add_settings();
  const Status status = line.parse(words);
  return status ? "" : status.error().message;
}

TEST(CommandLine, TheHelpOfAlgoNamesWhatTheTableHas) {
  static constexpr AlgorithmRow kOwn{.name = "algorithm_of_a_test"};
  if (find_algorithm(kOwn.name) == nullptr) add_algorithm(kOwn);
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {}), "");
  const std::string help = line.help();
  const std::size_t begin = help.find("--algo ");
  ASSERT_NE(begin, std::string::npos);
  const std::string of_algo = help.substr(begin, help.find("\n  --", begin) - begin);
  for (const std::string& name : algorithm_names()) EXPECT_THAT(of_algo, HasSubstr(name));
  EXPECT_THAT(of_algo, HasSubstr("algorithm_of_a_test"));
}

TEST(CommandLine, TakesValuesWithAndWithoutEqualsSign) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--seed=7", "--scenario", "lava_maze"}), "");
  EXPECT_THAT(line.typed().values, ElementsAre(Pair("scenario", "lava_maze"), Pair("seed", "7")));
  EXPECT_TRUE(line.was_typed("seed"));
  EXPECT_FALSE(line.was_typed("rollout"));
}

TEST(CommandLine, TakesBooleansBareAndSpelledOut) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--deterministic", "--async_rl=False", "--use_rnn", "True", "--seed", "1"}), "");
  EXPECT_THAT(line.typed().values, ElementsAre(Pair("seed", "1"), Pair("async_rl", "False"),
                                               Pair("deterministic", "True"), Pair("use_rnn", "True")));
}

TEST(CommandLine, GivesOldNamesTheirNewOne) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--env=coop_puzzle", "--lr", "1e-3"}), "");
  EXPECT_THAT(line.typed().values,
              ElementsAre(Pair("scenario", "coop_puzzle"), Pair("learning_rate", "1e-3")));
}

TEST(CommandLine, LetsTheLastOfARepeatedFlagCount) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--seed=1", "--seed=2", "--env=a", "--scenario=b"}), "");
  EXPECT_THAT(line.typed().values, ElementsAre(Pair("scenario", "b"), Pair("seed", "2")));
}

TEST(CommandLine, CollectsTheValuesOfAListFlag) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--reward", "a=1", "--seed=3", "--reward=b=-2"}), "");
  EXPECT_THAT(line.typed().values, ElementsAre(Pair("seed", "3"), Pair("reward", "a=1,b=-2")));
}

TEST(CommandLine, TakesNegativeNumbersAndEmptyTexts) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--shared_reward_alpha", "-1", "--wad="}), "");
  EXPECT_THAT(line.typed().values, ElementsAre(Pair("wad", ""), Pair("shared_reward_alpha", "-1")));
}

TEST(CommandLine, NamesTheNearestFlagForAnUnknownOne) {
  CommandLine line("train", "");
  const std::string message = parse(line, {"--batchsize=64"});
  EXPECT_THAT(message, HasSubstr("--batchsize"));
  EXPECT_THAT(message, HasSubstr("did you mean --batch_size?"));
}

TEST(CommandLine, RefusesAnUnknownFlagThatIsNearNothing) {
  CommandLine line("train", "");
  const std::string message = parse(line, {"--qqqqqqqqqqqq"});
  EXPECT_THAT(message, HasSubstr("unknown flag --qqqqqqqqqqqq"));
  EXPECT_THAT(message, Not(HasSubstr("did you mean")));
  EXPECT_THAT(message, HasSubstr("comrad help train lists every flag"));
}

TEST(CommandLine, TakesNamesOfSampleFactoryAndSuggestsNone) {
  CommandLine line("train", "");
  ASSERT_EQ(parse(line, {"--value_bootstrap", "--env_framestack=4"}), "");
  EXPECT_THAT(line.typed().values,
              UnorderedElementsAre(Pair("value_bootstrap", "True"), Pair("env_framestack", "4")));
  EXPECT_THAT(line.help(), Not(HasSubstr("--env_framestack")));
  CommandLine mistyped("train", "");
  EXPECT_THAT(parse(mistyped, {"--env_framestak=4"}), Not(HasSubstr("framestack?")));
}

TEST(CommandLine, RefusesAFlagWithoutItsValue) {
  CommandLine last("train", "");
  EXPECT_THAT(parse(last, {"--seed"}), HasSubstr("--seed needs a value"));
  CommandLine before_another("train", "");
  EXPECT_THAT(parse(before_another, {"--seed", "--rollout=8"}), HasSubstr("--seed needs a value"));
}

TEST(CommandLine, RefusesStrayWords) {
  CommandLine line("train", "");
  EXPECT_THAT(parse(line, {"ippo"}), HasSubstr("'ippo'"));
}

TEST(CommandLine, TakesAnyNumberOfWordsWhereACommandTakesThem) {
  std::string first;
  Words runs;
  CommandLine line("plot", "");
  line.add_positional("FIRST", first, "a word");
  line.add_words("RUN", runs, "runs to draw");
  ASSERT_EQ(parse(line, {"a", "b", "--seed", "7", "c"}), "");
  EXPECT_EQ(first, "a");
  EXPECT_THAT(runs, ElementsAre("b", "c"));
  EXPECT_THAT(line.help(), HasSubstr("runs to draw"));
}

TEST(CommandLine, RefusesAPositionalThatIsMissing) {
  CommandLine line("bench WHAT", "");
  std::string what;
  line.add_positional("WHAT", what, "what to measure");
  EXPECT_THAT(parse(line, {"--seed=1"}), HasSubstr("WHAT"));
}

TEST(CommandLine, KeepsAPositionalApartFromABareBoolean) {
  CommandLine line("bench WHAT", "");
  std::string what;
  bool json = false;
  line.add_positional("WHAT", what, "what to measure");
  line.add_switch("json", json, "one object");
  ASSERT_EQ(parse(line, {"--json", "sim"}), "");
  EXPECT_EQ(what, "sim");
  EXPECT_TRUE(json);
}

TEST(CommandLine, RefusesACommandsOwnFlagWithAWrongType) {
  double seconds = 1;
  CommandLine line("bench", "");
  line.add_option("seconds", seconds, "S", "how long");
  EXPECT_THAT(parse(line, {"--seconds=long"}), HasSubstr("--seconds=long"));
  EXPECT_EQ(seconds, 1);
}

TEST(CommandLine, StopsAtAnUnknownFlagBeforeHelp) {
  CommandLine line("train", "");
  EXPECT_THAT(parse(line, {"--no_such_flag", "--help"}), HasSubstr("--no_such_flag"));
}

TEST(CommandLine, HelpLinesFitAScreenAndEndWithoutBlanks) {
  CommandLine line("train", "Trains.");
  ASSERT_EQ(parse(line, {"--help"}), "");
  std::istringstream lines(line.help());
  for (std::string text; std::getline(lines, text);) {
    EXPECT_LE(text.size(), 110u) << text;
    EXPECT_FALSE(text.ends_with(' ')) << text;
  }
}

TEST(CommandLine, HelpNamesEverySettingWithItsDefaultAndOldName) {
  CommandLine line("train", "Trains.");
  ASSERT_EQ(parse(line, {"--help"}), "");
  EXPECT_TRUE(line.help_requested());
  const std::string help = line.help();
  for (const SettingRow& row : setting_rows())
    EXPECT_THAT(help, HasSubstr("--" + std::string(row.name) + " "));
  EXPECT_THAT(help, HasSubstr("also --env"));
  EXPECT_THAT(
      help,
      HasSubstr("rollout INT                   decisions of each agent in a trajectory, T (default 32)"));
  EXPECT_THAT(help, HasSubstr("1.0; with Q-learning and td_lambda below 0)"));
}

TEST(CommandLine, HelpReadsTheFlagsBesideIt) {
  std::string what;
  CommandLine line("bench WHAT", "");
  line.add_positional("WHAT", what, "what to measure");
  ASSERT_EQ(parse(line, {"--algo", "vdn", "--help"}), "") << "nothing is missing where help is requested";
  EXPECT_TRUE(line.help_requested());
  EXPECT_THAT(line.typed().values, ElementsAre(Pair("algo", "vdn")));
}

TEST(CommandLine, HelpShowsTheValuesInForceAndWhatDoesNothing) {
  CommandLine line("train", "Trains.");
  ASSERT_EQ(parse(line, {}), "");
  RunConfig config;
  config.run.algo = "ippo";
  config.optimisation.learning_rate = 4e-4;
  std::map<std::string, std::string> from;
  for (const SettingRow& row : setting_rows()) from[std::string(row.name)] = "built-in";
  from["learning_rate"] = "preset";
  const std::string help = line.help(ValuesInForce{config, from});
  EXPECT_THAT(help, HasSubstr("(4e-04, preset; built-in 1e-04;"));
  const std::size_t idle = help.find("Without effect with these values:");
  ASSERT_NE(idle, std::string::npos);
  EXPECT_EQ(help.find("--n_step"), std::string::npos);
  EXPECT_GT(help.find(" n_step,"), idle);
  EXPECT_LT(help.find("--gae_lambda"), idle);
}

TEST(CommandLine, HelpOfAnEvaluationListsWhatItUses) {
  CommandLine line("eval", "Plays.");
  line.add_settings(SettingsListed::kUsedByEval);
  ASSERT_TRUE(line.parse(Words{"--gamma=0.9"})) << "scripts that pass the flags of a run continue";
  const std::string help = line.help();
  for (const char* used : {"--scenario ", "--layout_pool ", "--num_workers ", "--device ", "--seed "})
    EXPECT_THAT(help, HasSubstr(used));
  for (const char* unused : {"--gamma ", "--learning_rate ", "--per ", "--save_every_sec ", "--rnn_size "})
    EXPECT_THAT(help, Not(HasSubstr(unused)));
}

}  // namespace command_line_test
}  // namespace comrad::deploy
