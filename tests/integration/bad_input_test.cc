// Bad input and bad luck: each case has one clear message, a non-zero exit and leaves nothing.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace bad_input_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr int kExitFailed = 1;
constexpr int kExitBadInput = 2;

/// Runs a small training that must be refused, and gives its ending.
Ending refused(const ScratchFolder& scratch, const std::vector<std::string>& more,
               const Environment& environment = {}) {
  RunningProgram training(small_training(scratch, "refused", 8192, more), environment);
  Ending ending = training.wait();
  EXPECT_FALSE(ending.timed_out);
  EXPECT_TRUE(processes_of(scratch.string()).empty());
  EXPECT_EQ(ending.out, "");
  return ending;
}

TEST(BadInput, AnUnknownFlagNamesTheNearest) {
  const Ending ending = comrad({"train", "--scenarioo", "coop_health_gathering"});
  EXPECT_EQ(ending.exit_code, kExitBadInput);
  EXPECT_THAT(ending.err, AllOf(HasSubstr("--scenarioo"), HasSubstr("did you mean --scenario?")));
}

TEST(BadInput, AnUnknownCommandNamesTheNearest) {
  const Ending ending = comrad({"trian"});
  EXPECT_EQ(ending.exit_code, kExitBadInput);
  EXPECT_THAT(ending.err, HasSubstr("did you mean 'train'?"));
}

TEST(BadInput, AWrongValueNamesTheSettingAndItsRange) {
  const ScratchFolder scratch;
  const Ending type = refused(scratch, {"--rollout", "many"});
  EXPECT_EQ(type.exit_code, kExitBadInput);
  EXPECT_THAT(type.err, AllOf(HasSubstr("rollout"), HasSubstr("many")));
  const Ending range = refused(scratch, {"--rnn_type", "transformer"});
  EXPECT_EQ(range.exit_code, kExitBadInput);
  EXPECT_THAT(range.err, AllOf(HasSubstr("rnn_type"), HasSubstr("gru"), HasSubstr("lstm")));
  const Ending video = refused(scratch, {"--film_every_env_frames", "-1"});
  EXPECT_EQ(video.exit_code, kExitBadInput);
  EXPECT_THAT(video.err, HasSubstr("video_every_env_frames"));
  const Ending encoder = refused(scratch, {"--encoder", "vit"});
  EXPECT_EQ(encoder.exit_code, kExitBadInput);
  EXPECT_THAT(encoder.err, HasSubstr("error: encoder is vit; it must be one of simple"));
}

TEST(BadInput, AnUnknownScenarioOrAlgorithmNamesTheKnownOnes) {
  const ScratchFolder scratch;
  const Ending scenario = refused(scratch, {"--scenario", "coop_health_gatherin"});
  EXPECT_EQ(scenario.exit_code, kExitBadInput);
  EXPECT_THAT(scenario.err, AllOf(HasSubstr("coop_health_gatherin"), HasSubstr("coop_health_gathering")));
  const Ending algorithm = refused(scratch, {"--algo", "ipo"});
  EXPECT_EQ(algorithm.exit_code, kExitBadInput);
  EXPECT_THAT(algorithm.err, AllOf(HasSubstr("ipo"), HasSubstr("ippo")));
}

TEST(BadInput, AnUnsupportedTeamSizeListsTheSupportedOnes) {
  const ScratchFolder scratch;
  const Ending ending = refused(scratch, {"--num_agents", "7"});
  EXPECT_EQ(ending.exit_code, kExitBadInput);
  EXPECT_THAT(ending.err, AllOf(HasSubstr("--num_agents=7"), HasSubstr("2")));
}

TEST(BadInput, AMissingIwadReportsHowToGetIt) {
  const ScratchFolder scratch;
  const Ending ending = refused(scratch, {}, {{"COMRAD_IWAD", "/nonexistent/freedoom2.wad"}});
  EXPECT_NE(ending.exit_code, 0);
  EXPECT_THAT(ending.err, AllOf(HasSubstr("/nonexistent/freedoom2.wad"), HasSubstr("COMRAD_IWAD")));
}

TEST(BadInput, ATruncatedWadIsNamedBeforeAnythingStarts) {
  const ScratchFolder scratch;
  const std::string whole = scratch / "whole.wad";
  ASSERT_EQ(comrad({"doomgen", "coop_health_gathering", "--seed", "42", "-o", whole}).exit_code, 0);
  const std::string bytes = read_text(whole);
  ASSERT_GT(bytes.size(), 1000u);
  for (const size_t length : {size_t{0}, size_t{11}, bytes.size() / 2, bytes.size() - 1}) {
    const std::string cut = scratch / "cut.wad";
    std::ofstream(cut, std::ios::binary) << bytes.substr(0, length);
    const Ending ending = refused(scratch, {"--wad", cut});
    EXPECT_EQ(ending.exit_code, kExitBadInput) << length;
    EXPECT_THAT(ending.err, HasSubstr("cut.wad")) << length;
  }
  EXPECT_FALSE(fs::exists(scratch / "refused"));
}

/// A user's scenario in `folder`: its map is my.wad.
void write_own_scenario(const ScratchFolder& folder, const std::string& wad) {
  folder.write("my_scenario/scenario.toml",
               "name = \"my_scenario\"\ntitle = \"Mine\"\nsummary = \"Mine.\"\ndifficulty = 1\n"
               "default_agents = 2\nsupported_agents = [2]\ndecision_limit = 20\nscore = \"survival_tics\"\n"
               "ceiling = 80\nwad = \"my.wad\"\n[[heads]]\nbuttons = [\"MOVE_FORWARD\"]\n");
  folder.write("my_scenario/my.wad", wad);
}

/// What each command that plays its own map making prints for the scenario in `folder`.
std::vector<std::string> complaints(const ScratchFolder& folder) {
  const std::string own = folder / "my_scenario";
  std::vector<std::string> said;
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"eval", "--policy", "random", "--episodes", "1", "--num_workers", "1", "--scenario", own},
           {"bench", "sim", "--seconds", "1", "--scenario", own},
           {"train", "--train_dir", folder / "runs", "--num_workers", "1", "--scenario", own},
           {"trace", own, "--random", "5"},
           {"scenarios", "--gallery", folder / "pictures", own}}) {
    const Ending ending = comrad(command);
    EXPECT_FALSE(ending.timed_out) << command[0];
    EXPECT_NE(ending.exit_code, 0) << command[0];
    if (command[0] == "trace") {
      EXPECT_EQ(ending.exit_code, 2) << ending.err;
    }
    EXPECT_THAT(ending.err, Not(HasSubstr("starts again"))) << "a map does not get better";
    said.push_back(ending.err);
  }
  return said;
}

TEST(BadInput, AScenarioThatIsNotWholeLeavesNoRunAndSparesAnOldOne) {
  const ScratchFolder scratch;
  const std::string own = scratch / "my_scenario";
  scratch.write("old/config.toml", "scenario = \"lava_pit\"\nalgo = \"ippo\"\n");
  write_own_scenario(scratch, "no map");
  const std::vector<std::string> overwrite = {"--experiment", "old", "--restart_behavior", "overwrite"};
  for (const auto& [more, message] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{}, "my.wad"}, {{"--layout_pool", "train:3"}, "no layout recipe"}, {overwrite, "my.wad"}}) {
    std::vector<std::string> words = {"--scenario", own};
    words.insert(words.end(), more.begin(), more.end());
    const Ending ending = refused(scratch, words);
    EXPECT_EQ(ending.exit_code, kExitBadInput);
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_FALSE(fs::exists(scratch / "refused")) << message;
    EXPECT_TRUE(fs::exists(scratch / "old/config.toml")) << "an old run must not go before the refusal";
  }
  scratch.write("my_scenario/scenario.toml", "name = \n");
  EXPECT_THAT(refused(scratch, {"--scenario", own}).err, HasSubstr("scenario.toml:1:"));
  EXPECT_FALSE(fs::exists(scratch / "refused"));
}

TEST(BadInput, AMapOfOnesOwnIsCalledByItsOwnName) {
  const ScratchFolder scratch;
  const std::string own = (scratch / "my_scenario/my.wad").string();
  ASSERT_EQ(comrad({"doomgen", "lava_pit", "-o", scratch / "pit.wad"}).exit_code, 0);
  write_own_scenario(scratch, read_text(scratch / "pit.wad"));
  for (const std::string& said : complaints(scratch))
    EXPECT_THAT(said, AllOf(HasSubstr(own + " is a map of scenario lava_pit, not of my_scenario"),
                            HasSubstr("comrad doomgen lava_pit --as my_scenario -o " + own),
                            Not(HasSubstr("/layouts/"))));

  ASSERT_EQ(comrad({"doomgen", "lava_pit", "--as", "my_scenario", "-o", own}).exit_code, 0);
  const Ending played = comrad({"eval", "--policy", "random", "--episodes", "1", "--num_workers", "1",
                                "--scenario", scratch / "my_scenario"});
  EXPECT_EQ(played.exit_code, 0) << played.err;

  // What only the engine finds out is said of the author's file, too.
  std::string broken = read_text(own);
  const std::size_t at = broken.find("heightceiling");
  ASSERT_NE(at, std::string::npos);
  broken.replace(at, 13, "heightceil=+=");
  std::ofstream(own, std::ios::binary) << broken;
  for (const std::string& said : complaints(scratch))
    EXPECT_THAT(said, AllOf(HasSubstr(own + ": TEXTMAP of MAP01"), Not(HasSubstr("/layouts/"))));
}

TEST(BadInput, TooLittleMemoryReportsWhatLowersIt) {
  const ScratchFolder scratch;
  const Ending ending = refused(scratch, {"--trajectory_slabs", "1000000"});
  EXPECT_EQ(ending.exit_code, kExitFailed);
  EXPECT_THAT(ending.err, HasSubstr("--trajectory_slabs"));
}

TEST(BadInput, ASettingsFileThatIsWrongIsNamedWithItsPlace) {
  const ScratchFolder scratch;
  const std::string path = scratch / "settings.toml";
  std::ofstream(path) << "seed = 1\nrolout = 8\n";
  const Ending unknown = refused(scratch, {"--config", path});
  EXPECT_EQ(unknown.exit_code, kExitBadInput);
  EXPECT_THAT(unknown.err, AllOf(HasSubstr("settings.toml"), HasSubstr("rollout")));
  std::ofstream(path) << "seed = = 1\n";
  const Ending broken = refused(scratch, {"--config", path});
  EXPECT_EQ(broken.exit_code, kExitBadInput);
  EXPECT_THAT(broken.err, HasSubstr("settings.toml:1:"));
}

TEST(BadInput, ARunDirectoryThatCannotBeMadeIsNamed) {
  const ScratchFolder scratch;
  std::ofstream(scratch / "file") << "no folder";
  const Ending ending = refused(scratch, {"--train_dir", scratch / "file"});
  EXPECT_NE(ending.exit_code, 0);
  EXPECT_THAT(ending.err, HasSubstr("file/refused"));
}

TEST(BadInput, EvaluationNamesARunThatIsNotThere) {
  const ScratchFolder scratch;
  const Ending ending =
      comrad({"eval", "--policy", "no_such_run", "--train_dir", scratch.string(), "--json"});
  EXPECT_EQ(ending.exit_code, kExitBadInput);
  EXPECT_EQ(ending.out, "");
  EXPECT_THAT(ending.err, HasSubstr("no_such_run"));
}

TEST(BadInput, AWorkerStartedByHandWithoutItsFlagsReportsWhatItNeeds) {
  for (const char* worker : {"comrad-sim-worker", "comrad-policy-worker", "comrad-learner"}) {
    const Ending ending = RunningProgram({program(worker)}).wait();
    EXPECT_EQ(ending.exit_code, kExitBadInput) << worker;
    EXPECT_THAT(ending.err, HasSubstr("--run_dir")) << worker;
  }
}

}  // namespace bad_input_test
}  // namespace comrad::test
