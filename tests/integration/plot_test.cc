// `comrad plot` on runs whose reports are written here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "tests/integration/running_program.h"

namespace comrad::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class Plot : public ::testing::Test {
 protected:
  void SetUp() override {
    if (comrad({"plot", "--help"}, 30).exit_code != 0) GTEST_FAIL();
    for (const char* python : {"/usr/bin/python3", "python3"})
      if (RunningProgram({"/bin/sh", "-c", std::string(python) + " -c 'import matplotlib'"})
              .wait(60)
              .exit_code == 0)
        return;
    GTEST_SKIP() << "no Python has matplotlib (deploy/packages_report.txt)";
  }
  /// A run of ten reports; `with_episodes` of them have a score.
  void make_run(const std::string& name, int seed, int with_episodes, const std::string& more = "") {
    std::string lines;
    for (int i = 0; i < 10; ++i) {
      nlohmann::ordered_json report = {
          {"time_s", 10 * i}, {"env_frames", 1000 * i}, {"train/entropy", 1.0 / (1 + i)}};
      if (i >= 10 - with_episodes) report["policy_stats/avg_true_objective"] = 100 + i * seed;
      lines += report.dump() + "\n";
    }
    folder_.write(name + "/metrics.jsonl", lines + more);
    folder_.write(name + "/config.toml",
                  "scenario = \"lava_pit\"\nalgo = \"ippo\"\nseed = " + std::to_string(seed) + "\n");
  }
  Ending plot(std::vector<std::string> words) {
    words.insert(words.begin(), "plot");
    words.insert(words.end(), {"--train_dir", folder_.string()});
    return comrad(words, 120);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  const ScratchFolder folder_;
};

TEST_F(Plot, DrawsRunsGroupsAndEvaluationsAndNamesWhatItLeavesOut) {
  make_run("one", 1, 10,
           R"({"time_s": 50, "env_frames": 5000, "decisions": 1250, "eval/J": 140})"
           "\n");
  make_run("two", 2, 8, "{\"time_s\": 95, \"env_fra");  // it goes on
  make_run("none", 3, 0);
  const Ending svg =
      plot({"one", "both=one,two", "none", "-o", path("curves.svg"), "--baseline", "random=90"});
  ASSERT_EQ(svg.exit_code, 0) << svg.err;
  EXPECT_EQ(svg.out, path("curves.svg") + "\n");
  EXPECT_THAT(svg.err,
              AllOf(HasSubstr("none: no episode has ended in 10 reports; left out"), Not(HasSubstr("two:"))));
  const std::string drawn = read_text(path("curves.svg"));
  EXPECT_THAT(drawn,
              AllOf(HasSubstr("<svg"), HasSubstr("one, evaluated"), HasSubstr("both (mean of 2, 95 %)"),
                    HasSubstr("random"), Not(HasSubstr("<!-- none"))));

  const Ending png =
      plot({"one", path("two"), "--over_seeds", "--x", "time_s", "--output", path("curves.png")});
  ASSERT_EQ(png.exit_code, 0) << png.err;
  EXPECT_THAT(read_text(path("curves.png")), StartsWith("\x89PNG"));
  const Ending grouped =
      plot({"one", "two", "--over_seeds", "-o", path("seeds.svg"), "--metric", "train/entropy"});
  ASSERT_EQ(grouped.exit_code, 0) << grouped.err;
  EXPECT_THAT(read_text(path("seeds.svg")), HasSubstr("lava_pit IPPO (mean of 2, 95 %)"));
}

TEST_F(Plot, RefusesWhatItCannotDraw) {
  make_run("one", 1, 10);
  make_run("none", 3, 0);
  for (const auto& [words, message] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{}, "name a run"},
           {{"ona"}, "did you mean 'one'?"},
           {{"x=one,twa"}, "no run 'twa'"},
           {{"x="}, "names no run"},
           {{"none"}, "nothing to draw"},
           {{"one", "-o", path("a.gif")}, "one of .png, .svg, .pdf"},
           {{"one", "-o", path("no/a.png")}, "is no folder"},
           {{"one", "--x", "frames"}, "unknown axis 'frames'"},
           {{"one", "--metric", "train/entropi"}, "did you mean train/entropy?"},
           {{"one", "--baseline", "90x"}, "NAME=VALUE"}}) {
    std::vector<std::string> all = words;
    if (std::ranges::find(all, "-o") == all.end()) all.insert(all.end(), {"-o", path("a.png")});
    const Ending ending = plot(all);
    EXPECT_EQ(ending.exit_code, 2) << message;
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_FALSE(std::filesystem::exists(path("a.png"))) << message;
  }
}

}  // namespace
}  // namespace comrad::testing
