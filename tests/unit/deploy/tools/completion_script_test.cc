// The script is run by bash.
#include "deploy/tools/completion_script.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "deploy/process/child_program.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace completion_script_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

const std::vector<CompletedCommand> kCommands = {
    {.name = "train",
     .flags = {{.names = {"scenario", "env"},
                .takes_value = true,
                .words = {"lava_pit", "lava_maze", "a$(touch oops)"}},
               {.names = {"rnn_type"}, .takes_value = true, .words = {"gru", "lstm"}},
               {.names = {"async_rl"}, .takes_value = true, .words = {"True", "False"}},
               {.names = {"config"}, .takes_value = true},
               {.names = {"json"}}}},
    {.name = "bench", .words = {"sim", "replay"}, .flags = {{.names = {"seconds"}, .takes_value = true}}},
    {.name = "version"}};

/// What bash would offer for these words, the last of which is being typed.
std::vector<std::string> offered(const std::vector<std::string>& words) {
  const test::ScratchFolder folder;
  folder.write("completion.bash", completion_script(kCommands));
  std::string script = "cd '" + folder.string() + "' && source completion.bash && COMP_WORDS=(";
  for (const std::string& word : words) script += "'" + word + "' ";
  script += ") COMP_CWORD=" + std::to_string(words.size() - 1) +
            " && _comrad; printf '%s\\n' \"${COMPREPLY[@]}\"; ls";
  const auto result = run_program({"bash", "--norc", "-c", script});
  EXPECT_TRUE(result && result->error_output.empty())
      << (result ? result->error_output : result.error().message);
  std::vector<std::string> lines;
  std::istringstream text(result ? result->output : "");
  for (std::string line; std::getline(text, line);)
    if (!line.empty()) lines.push_back(line);
  EXPECT_EQ(lines.empty() ? "" : lines.back(), "completion.bash") << "no file more: nothing was run";
  if (!lines.empty()) lines.pop_back();
  return lines;
}

TEST(CompletionScript, BashOffersCommandsFlagsAndValues) {
  EXPECT_THAT(offered({"comrad", ""}), ElementsAre("train", "bench", "version"));
  EXPECT_THAT(offered({"comrad", "tr"}), ElementsAre("train"));
  EXPECT_THAT(offered({"comrad", "train", "--s"}), ElementsAre("--scenario"));
  EXPECT_THAT(offered({"comrad", "train", "--scenario", ""}), ElementsAre("lava_pit", "lava_maze"));
  EXPECT_THAT(offered({"comrad", "train", "--env", "lava_m"}), ElementsAre("lava_maze")) << "an old name";
  EXPECT_THAT(offered({"comrad", "train", "--rnn_type", "=", "l"}), ElementsAre("lstm"));
  EXPECT_THAT(offered({"comrad", "train", "--rnn_type", "="}), ElementsAre("gru", "lstm"));
  EXPECT_THAT(offered({"comrad", "train", "--async_rl", "--j"}), ElementsAre("--json"))
      << "a boolean stands alone";
  EXPECT_THAT(offered({"comrad", "bench", "r"}), ElementsAre("replay"));
  EXPECT_THAT(offered({"comrad", "bench", "--seconds", "5", "s"}), ElementsAre("sim"));
}

TEST(CompletionScript, BashCompletesFilesWhereNoWordsAreKnown) {
  EXPECT_THAT(offered({"comrad", "train", "--config", ""}), IsEmpty());
  EXPECT_THAT(offered({"comrad", "version", ""}), IsEmpty());
  EXPECT_THAT(completion_script(kCommands), HasSubstr("complete -o default -F _comrad comrad"));
}

TEST(CompletionScript, LeavesOutWordsThatAShellWouldRun) {
  EXPECT_THAT(completion_script(kCommands), Not(HasSubstr("touch")));
}

TEST(FlagsOfHelp, ReadsOursAndThoseOfCli11) {
  const auto flags = flags_of_help(
      "usage: comrad eval --policy NAME\n\nThis command:\n"
      "  --policy NAME                   random or oracle\n"
      "                                  --not_this one\n"
      "  --json                          print one object\n"
      "  -h,--help                   Print this\n"
      "  -o,--out TEXT               file to write\n"
      "  --format TEXT:{udmf,hexen}=udmf\n"
      "                              map format\n"
      "  --vary,--no-vary{false}     draw\n"
      "  --start-from,--start_from TEXT\n"
      "  -q                          no long name\n  --\n  -");
  std::vector<std::string> names, values;
  for (const CompletedFlag& flag : flags) {
    names.push_back(flag.names[0]);
    if (flag.takes_value) values.push_back(flag.names[0]);
  }
  EXPECT_THAT(names, ElementsAre("policy", "json", "help", "out", "format", "vary", "start-from"));
  EXPECT_THAT(values, ElementsAre("policy", "out", "format", "start-from"));
  EXPECT_THAT(flags[4].words, ElementsAre("udmf", "hexen"));
  EXPECT_THAT(flags[5].names, ElementsAre("vary", "no-vary"));
}

}  // namespace completion_script_test
}  // namespace comrad::deploy
