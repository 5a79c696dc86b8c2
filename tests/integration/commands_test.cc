// What holds for every command: --help prints a help and starts nothing. And `comrad config`, which starts nothing either.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace commands_test {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsSupersetOf;

/// The commands that `comrad help` lists, with their words before the flags.
std::vector<std::vector<std::string>> commands_of_the_overview() {
  std::vector<std::vector<std::string>> commands;
  std::istringstream overview(comrad({"help"}).out);
  bool is_list = false;
  for (std::string line; std::getline(overview, line);) {
    if (line.starts_with("usage: ")) is_list = true;
    if (!is_list || !line.starts_with("  ")) continue;
    std::istringstream words(line);
    std::string name;
    if (words >> name && name != "help" && name != "version") commands.push_back({name});
  }
  return commands;
}

TEST(Help, EveryCommandAndSubcommandPrintsItAndStartsNothing) {
  std::vector<std::vector<std::string>> commands = commands_of_the_overview();
  EXPECT_GE(commands.size(), 10u);
  for (const std::vector<std::string>& more :
       std::vector<std::vector<std::string>>{{"bench", "sim"},
                                             {"bench", "inference"},
                                             {"bench", "learner"},
                                             {"bench", "train"},
                                             {"bench", "replay"},
                                             {"bench", "transport"},
                                             {"bench", "scaling"},
                                             {"bench", "train", "--seconds", "60"},
                                             {"scenarios", "list"},
                                             {"scenarios", "describe"},
                                             {"scenarios", "--gallery"},
                                             {"doomgen", "lava_pit"},
                                             {"eval", "--policy", "random"},
                                             {"train", "--scenario", "lava_pit"},
                                             {"config", "--json"},
                                             {"doctor", "--json"},
                                             {"top", "--once"},
                                             {"ctl", "a_run", "status"},
                                             {"ctl", "a_run", "drain", "host"},
                                             {"test", "-L", "unit"}})
    commands.push_back(more);
  for (const std::vector<std::string>& command : commands)
    for (const char* flag : {"--help", "-h"}) {
      const ScratchFolder scratch;
      std::vector<std::string> words = command;
      words.emplace_back(flag);
      std::string said;
      for (const std::string& word : words) said += word + " ";
      const Ending ending = comrad(words, {{"TMPDIR", scratch.string()}});
      EXPECT_FALSE(ending.timed_out) << said;
      EXPECT_EQ(ending.exit_code, 0) << said << ending.err;
      EXPECT_THAT(ending.out, AnyOf(HasSubstr("usage: comrad " + command[0]), HasSubstr("Usage: comrad")))
          << said;
      EXPECT_EQ(ending.err, "") << said;
      EXPECT_TRUE(files(scratch.string(), "").empty()) << said << "left something in the temporary folder";
    }
  EXPECT_FALSE(std::filesystem::exists("--help")) << "a folder of pictures";
}

TEST(Help, ShowsWhatPeopleChangeFirstAndWithAllEverySetting) {
  const Ending plain = comrad({"help", "train"});
  ASSERT_EQ(plain.exit_code, 0) << plain.err;
  EXPECT_THAT(plain.out,
              AllOf(HasSubstr("--scenario TEXT"), HasSubstr("--learning_rate SCHEDULE"),
                    HasSubstr("more: comrad help train --all"), HasSubstr("comrad help train --algo")));
  EXPECT_THAT(plain.out, ::testing::Not(AnyOf(HasSubstr("--plr_rho"), HasSubstr("\nOn policy\n"))));
  EXPECT_THAT(plain.out, HasSubstr("preset; built-in")) << "the default preset's values";
  const Ending all = comrad({"help", "train", "--all"});
  EXPECT_THAT(all.out,
              AllOf(HasSubstr("\nOn policy\n"), HasSubstr("\nCurriculum\n"), HasSubstr("--plr_rho")));
  const Ending misplaced = comrad({"train", "--all"});
  EXPECT_EQ(misplaced.exit_code, 2);
  EXPECT_THAT(misplaced.err, HasSubstr("comrad help train --all"));
}

TEST(Help, WithFlagsShowsTheValuesThatHoldForThem) {
  const Ending help = comrad({"help", "train", "--all", "--algo", "vdn", "--scenario", "stag_hunt_arena"});
  ASSERT_EQ(help.exit_code, 0) << help.err;
  EXPECT_THAT(help.out, HasSubstr("(5e-04, preset; built-in 1e-04;"));
  EXPECT_THAT(help.out, ::testing::ContainsRegex("0: off \\(0\\.0,[ \n]+scenario;[ \n]+built-in 100\\.0\\)"))
      << "q_value_clamp";
  const std::size_t idle = help.out.find("Without effect with these values:");
  ASSERT_NE(idle, std::string::npos);
  EXPECT_GT(help.out.find(" gae_lambda,"), idle);
  const Ending unknown = comrad({"help", "train", "--scenario", "nowhere"});
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("nowhere"));
}

TEST(Help, OfAnEvaluationListsWhatItUses) {
  const std::string help = comrad({"help", "eval"}).out;
  EXPECT_THAT(help, AllOf(HasSubstr("--episodes N"), HasSubstr("--layout_pool TEXT")));
  EXPECT_THAT(help, ::testing::Not(AnyOf(HasSubstr("--learning_rate"), HasSubstr("--epsilon_per_head"))));
}

/// What a text of the form "comrad-..." in `folder`'s sources names.
std::set<std::string> programs_named_in(const std::filesystem::path& folder) {
  std::set<std::string> names = {"comrad"};
  const std::regex literal("\"(comrad-[a-z-]+)\"");
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".cc") continue;
    const std::string text = read_text(entry.path().string());
    for (std::sregex_iterator found(text.begin(), text.end(), literal), end; found != end; ++found)
      if (std::filesystem::exists(program((*found)[1]))) names.insert((*found)[1]);
  }
  return names;
}

TEST(Programs, AFreshBuildHasEachThatTheLauncherStarts) {
  const std::set<std::string> started = programs_named_in(COMRAD_SOURCE_DIR "/deploy");
  EXPECT_THAT(started,
              IsSupersetOf({"comrad-acs", "comrad-doomgen", "comrad-learner", "comrad-policy-worker",
                            "comrad-scenarios", "comrad-sim-video", "comrad-sim-worker", "comrad-trace"}));
  // What the targets make that ./comrad builds, by the build system's own word. Only these two wait for their command.
  const std::string build = std::filesystem::path(COMRAD_BIN_DIR).parent_path().string();
  std::set<std::string> built;
  for (const char* target : {"programs", "tools"}) {
    const Ending query =
        RunningProgram({"/bin/sh", "-c", "ninja -C '" + build + "' -t query " + target}).wait();
    ASSERT_EQ(query.exit_code, 0) << query.err;
    std::istringstream words(query.out.substr(0, query.out.find("outputs:")));
    for (std::string word; words >> word;)
      if (word.starts_with("bin/")) built.insert(word.substr(4));
    for (const std::string& name : started) {
      if (target == std::string("programs") && (name == "comrad-acs" || name == "comrad-trace")) continue;
      EXPECT_THAT(built, Contains(name)) << "not in the target " << target;
    }
  }
}

TEST(Scenarios, HelpNamesTheGalleryAndItsFlagsAreRead) {
  const ScratchFolder scratch;
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
           {"--help"}, {"--gallery", "--help"}, {"--gallery", scratch / "x", "-h"}}) {
    std::vector<std::string> command = {"scenarios"};
    command.insert(command.end(), words.begin(), words.end());
    const Ending help = comrad(command);
    EXPECT_EQ(help.exit_code, 0) << help.err;
    EXPECT_THAT(help.out, AllOf(HasSubstr("--gallery DIR"), HasSubstr("--decisions"), HasSubstr("describe")));
  }
  EXPECT_FALSE(std::filesystem::exists(scratch / "x"));
  EXPECT_THAT(comrad({"help"}).out, HasSubstr("--gallery DIR"));

  const Ending nowhere = comrad({"scenarios", "--gallery"});
  EXPECT_EQ(nowhere.exit_code, 2);
  EXPECT_THAT(nowhere.err, HasSubstr("--gallery needs a folder"));
  const Ending lonely = comrad({"scenarios", "--decisions", "3"});
  EXPECT_EQ(lonely.exit_code, 2);
  EXPECT_THAT(lonely.err, HasSubstr("--gallery"));
  const Ending word = comrad({"scenarios", "lava_pit"});
  EXPECT_EQ(word.exit_code, 2);
  EXPECT_THAT(word.err, HasSubstr("comrad scenarios describe lava_pit"));

  const Ending drawn = comrad(
      {"scenarios", "--decisions", "2", "--size", "64x48", "--gallery", scratch / "pictures", "lava_pit"});
  EXPECT_EQ(drawn.exit_code, 0) << drawn.err;
  EXPECT_TRUE(std::filesystem::exists(scratch / "pictures/lava_pit.png"));
  EXPECT_FALSE(std::filesystem::exists(scratch / "pictures/games.png"));
  const Ending both = comrad({"scenarios", "--decisions", "2", "--size", "64x48", "--gallery",
                              scratch / "two", "lava_pit", "rhythm_sync"});
  EXPECT_EQ(both.exit_code, 0) << both.err;
  EXPECT_THAT(both.out, HasSubstr("games.png"));
  EXPECT_TRUE(std::filesystem::exists(scratch / "two/games.png"));
}

TEST(Scenarios, ListNamesEachVersion) {
  EXPECT_THAT(comrad({"scenarios"}).out, AllOf(HasSubstr("lava_pit"), HasSubstr("version 1, difficulty 5"),
                                               HasSubstr("version 2, difficulty 5")));
}

TEST(Help, MetricsListsWhatARunReports) {
  const Ending listed = comrad({"help", "metrics"});
  EXPECT_EQ(listed.exit_code, 0) << listed.err;
  EXPECT_THAT(listed.out,
              AllOf(HasSubstr("train/kl_divergence"), HasSubstr("policy lag"), HasSubstr("nats")));
  EXPECT_EQ(comrad({"help", "metrics", "--yaml"}).exit_code, 2);
}

TEST(Docs, ReportsWhatItExpected) {
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"docs"}, {"docs", "--serve", "--build", "x"}}) {
    const Ending ending = comrad(words);
    EXPECT_EQ(ending.exit_code, 2);
    EXPECT_THAT(ending.err, HasSubstr("expected --serve, --build DIR or --update"));
  }
}

TEST(Scenarios, DescribeCountsMeasurementsAndListsTerms) {
  const Ending ending = comrad({"scenarios", "describe", "ammo_carrier", "--json"});
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  const auto described = nlohmann::json::parse(ending.out, nullptr, false);
  ASSERT_TRUE(described.is_object());
  EXPECT_GT(described["measurements"], 0);
  for (const char* list : {"rewards", "exported_variables", "layout_parameters"})
    EXPECT_FALSE(described[list].empty()) << list;
  EXPECT_THAT(comrad({"scenarios", "describe", "ammo_carrier"}).out,
              AllOf(HasSubstr("Rewards"), HasSubstr("Measurements"), HasSubstr("Exported variables"),
                    HasSubstr("Layout parameters")));
}

TEST(Scenarios, DescribeFindsAFolderByItsNameAndLeavesNothingUnknownAsZero) {
  const ScratchFolder scratch;
  scratch.write("my_scenario/scenario.toml",
                "name = \"my_scenario\"\nbase = \"lava_pit\"\ntitle = \"Mine\"\n");
  const auto here = [&](const std::string& words) {
    return RunningProgram(
               {"/bin/sh", "-c", "cd '" + scratch.string() + "' && '" + program("comrad") + "' " + words})
        .wait();
  };
  const Ending described = here("scenarios describe my_scenario");
  EXPECT_EQ(described.exit_code, 0) << described.err;
  EXPECT_THAT(described.out, HasSubstr("Mine (my_scenario)"));
  EXPECT_THAT(here("config --scenario my_scenario").out, HasSubstr((scratch / "my_scenario").string()));

  ASSERT_EQ(here("doomgen lava_pit -o plain.wad").exit_code, 0);
  scratch.write("plain.cfg", "doom_scenario_path = plain.wad\navailable_buttons = { ATTACK }\n");
  const Ending cfg = here("scenarios describe ./plain.cfg");
  EXPECT_EQ(cfg.exit_code, 0) << cfg.err;
  EXPECT_THAT(cfg.out, AllOf(HasSubstr("difficulty unknown"), HasSubstr("ceiling unknown")));
}

/// What bash offers for these words with the script that `comrad completion bash` prints.
std::string offered_by_bash(const ScratchFolder& scratch, const std::string& words, int place) {
  return RunningProgram({"/bin/bash", "--norc", "-c",
                         "source '" + (scratch / "completion.bash").string() + "' && COMP_WORDS=(" + words +
                             ") COMP_CWORD=" + std::to_string(place) +
                             " && _comrad && echo \"${COMPREPLY[@]}\""})
      .wait()
      .out;
}

TEST(Completion, BashCompletesAFlagAValueAndAScenario) {
  const ScratchFolder scratch;
  const Ending ending = comrad({"completion", "bash"});
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  std::ofstream(scratch / "completion.bash") << ending.out;
  EXPECT_EQ(offered_by_bash(scratch, "comrad comp", 1), "completion\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad train --gae_", 2), "--gae_lambda\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad train --algo qplex", 3), "qplex_d qplex_q\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad train --preset = p", 4), "paper\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad config --scenario lava", 3), "lava_maze lava_pit\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad doomgen stag", 2), "stag_hunt_arena\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad doomgen lava_pit --format u", 4), "udmf\n");
  EXPECT_EQ(offered_by_bash(scratch, "comrad help do", 2), "doomgen docs doctor\n");
}

TEST(Completion, AnUnknownShellIsBadInput) {
  for (const auto& [shell, named] :
       {std::pair{"bsh", "did you mean 'bash'?"}, {"zsh", "zsh reads bash's script"}}) {
    const Ending ending = comrad({"completion", shell});
    EXPECT_EQ(ending.exit_code, 2);
    EXPECT_THAT(ending.err, HasSubstr(named));
  }
}

TEST(Config, PrintsEverySettingWithItsTypeAndLayer) {
  const ScratchFolder scratch;
  std::ofstream(scratch / "own.toml") << "preset = \"paper\"\nrollout = 16\n";
  const Ending ending = comrad({"config", "--scenario", "lava_pit", "--algo", "mappo", "--config",
                                scratch / "own.toml", "--lr", "3e-4", "--json"});
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  const auto document = nlohmann::json::parse(ending.out, nullptr, false);
  ASSERT_TRUE(document.is_object() && document.size() == 1 && document["settings"].is_object()) << ending.out;
  const nlohmann::json& settings = document["settings"];
  EXPECT_EQ(settings["learning_rate"], (nlohmann::json{{"value", 3e-4}, {"from", "command line"}}));
  EXPECT_EQ(settings["rollout"], (nlohmann::json{{"value", 16}, {"from", "file"}}));
  EXPECT_EQ(settings["preset"], (nlohmann::json{{"value", "paper"}, {"from", "file"}}));
  EXPECT_EQ(settings["rnn_type"], (nlohmann::json{{"value", "lstm"}, {"from", "algorithm"}}));
  EXPECT_EQ(settings["gamma"], (nlohmann::json{{"value", 0.99}, {"from", "built-in"}}))
      << "small has the scenario's";
  EXPECT_EQ(settings["use_rnn"]["value"], true);
  EXPECT_EQ(settings["shared_reward_alpha"], (nlohmann::json{{"value", 1.0}, {"from", "scenario"}}));
  EXPECT_EQ(settings["num_agents"], (nlohmann::json{{"value", 2}, {"from", "scenario"}}));
  EXPECT_EQ(settings["trajectory_slabs"]["from"], "automatic");
  for (const auto& [name, setting] : settings.items()) EXPECT_EQ(setting.size(), 2u) << name;

  const Ending small = comrad({"config", "--scenario", "lava_pit", "--algo", "mappo"});
  ASSERT_EQ(small.exit_code, 0) << small.err;
  EXPECT_THAT(small.out, ::testing::ContainsRegex("\ngamma +0\\.9995 +scenario\n"));
  EXPECT_THAT(small.out, ::testing::ContainsRegex("\nrnn_type +gru +preset\n"));
}

TEST(Config, RefusesWhatTrainRefuses) {
  const auto refusal = [](std::vector<std::string> more) {
    more.insert(more.begin(), "config");
    const Ending ending = comrad(more);
    EXPECT_EQ(ending.exit_code, 2) << ending.err;
    EXPECT_EQ(ending.out, "");
    return ending.err;
  };
  EXPECT_THAT(refusal({"--preset", "papr"}),
              AllOf(HasSubstr("comrad config: error:"), HasSubstr("did you mean 'paper'")));
  EXPECT_THAT(refusal({"--gama", "1"}), HasSubstr("did you mean --gamma"));
  EXPECT_THAT(refusal({"--gamma", "2"}), HasSubstr("gamma is 2.0"));
  EXPECT_THAT(refusal({"--scenario", "lava_pt"}), HasSubstr("did you mean 'lava_pit'"));
  EXPECT_THAT(refusal({"--config", "/no/such.toml"}), HasSubstr("cannot read /no/such.toml"));
  EXPECT_THAT(refusal({"--encoder", "mynet"}), HasSubstr("mynet"));
  const Ending too_short = comrad({"config", "--algo", "vdn", "--train_for_env_frames", "1000"});
  EXPECT_EQ(too_short.exit_code, 2);
  EXPECT_THAT(too_short.err, HasSubstr("learning begins at"));
  EXPECT_THAT(too_short.out, HasSubstr("learning_starts_decisions")) << "the values say why";
}

TEST(Keys, AreMadeShownAndNeverReplaced) {
  const ScratchFolder scratch;
  const std::string folder = (scratch / "keys").string();
  const Ending made = comrad({"keys", "make", folder, "--hosts", "alpha,beta", "--days", "30"});
  EXPECT_EQ(made.exit_code, 0) << made.err;
  EXPECT_THAT(made.out, AllOf(HasSubstr(folder + "/run"), HasSubstr("hosts/alpha"), HasSubstr("scp -r")));
  EXPECT_EQ(comrad({"keys", "add", folder, "--hosts", "gamma"}).exit_code, 0);
  EXPECT_THAT(comrad({"keys", "show", folder + "/hosts/gamma"}).out, HasSubstr("host"));
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{"keys", "make", folder, "--hosts", "delta"},
                                             {"keys", "add", folder, "--hosts", "alpha"},
                                             {"keys", "add", folder, "--hosts", "d/e"},
                                             {"keys", "make", folder + "2", "--days", "0.5"},
                                             {"keys", "show", folder + "/nowhere"},
                                             {"keys", "mak", folder}}) {
    const Ending refused = comrad(wrong);
    EXPECT_EQ(refused.exit_code, 2) << wrong[1];
    EXPECT_THAT(refused.err, HasSubstr("comrad keys: error: "));
  }
  std::filesystem::remove(folder + "/hosts/beta/permissions.p7s");
  const Ending shown = comrad({"keys", "show", folder});
  EXPECT_EQ(shown.exit_code, 2);
  EXPECT_THAT(shown.out, AllOf(HasSubstr("permissions.p7s"), HasSubstr("hosts/gamma")));
}

}  // namespace commands_test
}  // namespace comrad::test
