// The generator's and the compiler's commands as a user types them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace generator_programs_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr int kExitBadInput = 2;

TEST(Doomgen, TheSameSeedGivesTheSameBytesAndAnotherOneOthers) {
  const ScratchFolder scratch;
  for (const auto& [file, seed] :
       std::vector<std::pair<std::string, std::string>>{{"a.wad", "7"}, {"b.wad", "7"}, {"c.wad", "8"}}) {
    const Ending made = comrad({"doomgen", "stag_hunt_arena", "--seed", seed, "-o", scratch / file});
    ASSERT_EQ(made.exit_code, 0) << made.err;
    EXPECT_THAT(made.out, AllOf(HasSubstr("seed " + seed), HasSubstr("hash ")));
  }
  EXPECT_EQ(read_text(scratch / "a.wad"), read_text(scratch / "b.wad"));
  EXPECT_NE(read_text(scratch / "a.wad"), read_text(scratch / "c.wad"));
}

TEST(Doomgen, PoolsForTrainingAndEvaluationShareNothing) {
  const ScratchFolder scratch;
  std::set<std::string> maps;
  for (const char* kind : {"train", "eval"}) {
    const std::string folder = scratch / kind;
    const Ending made = comrad({"doomgen", "rhythm_sync", "--pool", kind, "--count", "6", "-o", folder});
    ASSERT_EQ(made.exit_code, 0) << made.err;
    EXPECT_THAT(made.out,
                AllOf(HasSubstr("6 layouts of rhythm_sync, 6 distinct maps"), HasSubstr(" drawn, of which "),
                      HasSubstr(std::string(kind) == "eval" ? "are for training" : "are for evaluation")));
    const nlohmann::json registry = read_json(folder + "/batch_registry.json");
    ASSERT_EQ(registry.size(), 6u);
    for (const auto& layout : registry) {
      EXPECT_EQ(layout["split"], kind);
      EXPECT_EQ(layout["scenario_version"], 1);
      EXPECT_TRUE(fs::exists(folder + "/" + layout["filename"].get<std::string>()));
      EXPECT_TRUE(maps.insert(layout["map_hash"].get<std::string>()).second);
    }
    const Ending checked = comrad({"doomgen", "check", folder, "--scenario", "rhythm_sync"});
    EXPECT_EQ(checked.exit_code, 0) << checked.err;
    EXPECT_THAT(checked.out, HasSubstr("6 layouts, all there and whole, 6 distinct maps"));
  }
  const Ending refused = comrad({"doomgen", "check", scratch / "eval", "--for", "train"});
  EXPECT_EQ(refused.exit_code, kExitBadInput);
  EXPECT_THAT(refused.err, HasSubstr("for evaluation"));
}

TEST(Doomgen, ReportsHowManyMapsARecipeCanMake) {
  const auto said = [](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"doomgen", "lava_maze", "--distinct"});
    const Ending counted = comrad(arguments);
    EXPECT_EQ(counted.exit_code, 0) << counted.err;
    return counted.out;
  };
  EXPECT_THAT(said({"60", "--no-vary"}), HasSubstr("lava_maze: 1 map (all there are: 60 draws"));
  EXPECT_THAT(said({"150", "--set", "variety=0"}), HasSubstr("lava_maze: 6 distinct maps (all there are"));
  EXPECT_THAT(said({"60"}),
              HasSubstr("at least 591 distinct maps (95 % confidence: 60 draws, all different)"));
  const ScratchFolder scratch;
  const Ending few = comrad(
      {"doomgen", "lava_maze", "--pool", "train", "--count", "9", "--variety", "0", "-o", scratch / "few"});
  EXPECT_EQ(few.exit_code, kExitBadInput);
  EXPECT_THAT(few.err, AllOf(HasSubstr("9 layouts for training were requested"), HasSubstr("distinct ones"),
                             HasSubstr("--count")));
  EXPECT_TRUE(fs::is_empty(scratch / "few")) << "a folder of WADs would be a pool";
}

TEST(Doomgen, OrganicOutlinesAreAFlag) {
  const ScratchFolder scratch;
  ASSERT_EQ(comrad({"doomgen", "smart_enemies", "-o", scratch / "plain.wad"}).exit_code, 0);
  const Ending organic =
      comrad({"doomgen", "smart_enemies", "--organic", "1", "-o", scratch / "organic.wad"});
  ASSERT_EQ(organic.exit_code, 0) << organic.err;
  EXPECT_GT(read_text(scratch / "organic.wad").size(), 2 * read_text(scratch / "plain.wad").size());
}

TEST(Doomgen, AGridIsDrawnAndMistakesInItAreNamed) {
  const ScratchFolder scratch;
  const Ending made = comrad({"doomgen", "lava_maze", "--grid", "side=4,6", "--grid", "seed=0,1,2", "--limit",
                              "5", "-o", scratch / "grid"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_EQ(files(scratch / "grid", "lava_maze_", ".wad").size(), 5u);
  for (const char* axis : {"side", "side=", "side=4,", "side=four", "=4"}) {
    const Ending bad = comrad({"doomgen", "lava_maze", "--grid", axis, "-o", scratch / "bad"});
    EXPECT_EQ(bad.exit_code, kExitBadInput) << axis;
    EXPECT_THAT(bad.err, HasSubstr("name=value")) << axis;
  }
}

TEST(Doomgen, AMapIsShownFromAbove) {
  const ScratchFolder scratch;
  ASSERT_EQ(comrad({"doomgen", "lava_pit", "-o", scratch / "map.wad"}).exit_code, 0);
  const Ending shown = comrad({"doomgen", "show", scratch / "map.wad", "--size", "320"});
  ASSERT_EQ(shown.exit_code, 0) << shown.err;
  EXPECT_THAT(shown.out, AllOf(HasSubstr("320x"), HasSubstr("sectors"), HasSubstr("things")));
  const std::string picture = read_text(scratch / "map.png");
  ASSERT_GT(picture.size(), 24u);
  EXPECT_EQ(picture.substr(1, 3), "PNG");
  // Width and height stand behind the first chunk's name, high byte first.
  const auto number = [&](std::size_t at) {
    return (static_cast<unsigned char>(picture[at + 2]) << 8) + static_cast<unsigned char>(picture[at + 3]);
  };
  EXPECT_EQ(std::max(number(16), number(20)), 320);
  ASSERT_EQ(comrad({"doomgen", "show", "lava_pit", "--size", "320", "-o", scratch / "drawn.png"}).exit_code,
            0);
  EXPECT_EQ(read_text(scratch / "drawn.png"), picture) << "the scenario's default layout is the same map";
  const Ending unknown = comrad({"doomgen", "show", "lava_pot", "-o", scratch / "x.png"});
  EXPECT_EQ(unknown.exit_code, kExitBadInput);
  EXPECT_THAT(unknown.err, HasSubstr("lava_pit"));
  const Ending missing = comrad({"doomgen", "show", scratch / "none.wad", "-o", scratch / "x.png"});
  EXPECT_NE(missing.exit_code, 0);
  EXPECT_THAT(missing.err, HasSubstr("none.wad"));
}

TEST(Doomgen, NodesAreBuiltOnRequestWhereZdbspIsInstalled) {
  const ScratchFolder scratch;
  const Ending made = comrad({"doomgen", "rhythm_sync", "--nodes", "-o", scratch / "map.wad"});
  if (made.err.find("zdbsp is not installed") != std::string::npos)
    GTEST_SKIP() << "zdbsp is not installed (deploy/packages_test.txt; ./comrad test installs it)";
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_THAT(read_text(scratch / "map.wad"), HasSubstr("ZNODES"));
}

TEST(Doomgen, MistakesAreNamed) {
  const ScratchFolder scratch;
  const auto error = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "doomgen");
    const Ending ending = comrad(arguments);
    EXPECT_EQ(ending.exit_code, kExitBadInput);
    return ending.err;
  };
  const std::string out = scratch / "x";
  EXPECT_THAT(error({"lava_pitt", "-o", out}), HasSubstr("lava_pit"));
  EXPECT_THAT(error({"lava_pit", "--set", "no_such=1", "-o", out}), HasSubstr("no_such"));
  EXPECT_THAT(error({"lava_pit", "--as", "a/path", "-o", out}), HasSubstr("give the scenario's name"));
  EXPECT_THAT(error({"lava_pit", "--as", "mine", "--pool", "train", "-o", out}), HasSubstr("--pool"));
  EXPECT_THAT(error({"lava_pit", "--pool", "train", "--count", "0", "-o", out}), HasSubstr("1..100000"));
  EXPECT_THAT(error({"lava_pit", "--pool", "testing", "-o", out}), HasSubstr("curriculum"));
  EXPECT_THAT(error({"lava_pit", "--pool", "curriculum", "-o", out}), HasSubstr("platform_chain"));
  EXPECT_THAT(error({"check", scratch / "nowhere"}), HasSubstr("nowhere"));
  EXPECT_THAT(error({"lava_pit"}), HasSubstr("-o"));
  EXPECT_THAT(error({"lava_pit", "--distinct", "1"}), HasSubstr("--distinct"));
}

TEST(Acs, AScriptIsCompiledAndAMistakeHasItsPlace) {
  const ScratchFolder scratch;
  std::ofstream(scratch / "good.acs") << "#include \"zcommon.acs\"\nscript 1 OPEN { Delay(35); }\n";
  const Ending good = comrad({"acs", scratch / "good.acs"});
  ASSERT_EQ(good.exit_code, 0) << good.err;
  EXPECT_EQ(read_text(scratch / "good.o").substr(0, 3), "ACS");
  const Ending named = comrad({"acs", scratch / "good.acs", "-o", scratch / "other.lmp"});
  ASSERT_EQ(named.exit_code, 0) << named.err;
  EXPECT_EQ(read_text(scratch / "other.lmp"), read_text(scratch / "good.o"));

  std::ofstream(scratch / "bad.acs") << "#include \"zcommon.acs\"\nscript 1 OPEN\n{\n  Delay(35;\n}\n";
  const Ending bad = comrad({"acs", scratch / "bad.acs", "-o", scratch / "bad.o"});
  EXPECT_NE(bad.exit_code, 0);
  EXPECT_THAT(bad.err, HasSubstr("bad.acs:4:"));
  EXPECT_FALSE(fs::exists(scratch / "bad.o"));
  EXPECT_NE(comrad({"acs", scratch / "none.acs"}).exit_code, 0);
  EXPECT_EQ(comrad({"acs", "--help"}).exit_code, 0);
}

}  // namespace generator_programs_test
}  // namespace comrad::test
