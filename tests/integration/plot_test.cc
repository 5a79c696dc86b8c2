// `comrad plot` and `comrad export` on runs whose reports are written here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "tests/integration/running_program.h"
#include "tests/support/test_python.h"

namespace comrad::test {
namespace plot_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class WithRuns : public ::testing::Test {
 protected:
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
  Ending run(const char* command, std::vector<std::string> words, const Environment& environment = {}) {
    words.insert(words.begin(), command);
    words.insert(words.end(), {"--train_dir", folder_.string()});
    return comrad(words, environment);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  const ScratchFolder folder_;
};

class Plot : public WithRuns {
 protected:
  void SetUp() override {
    if (comrad({"plot", "--help"}).exit_code != 0) GTEST_FAIL();
    for (const char* python : {"/usr/bin/python3", "python3"})
      if (RunningProgram({"/bin/sh", "-c", std::string(python) + " -c 'import matplotlib'"})
              .wait()
              .exit_code == 0)
        return;
    GTEST_SKIP() << "no Python has matplotlib (deploy/packages_report.txt)";
  }
  Ending plot(const std::vector<std::string>& words) { return run("plot", words); }
};

TEST_F(Plot, DrawsRunsGroupsAndEvaluationsAndNamesWhatItLeavesOut) {
  make_run("one", 1, 10,
           R"({"time_s": 50, "env_frames": 5000, "decisions": 1250, "eval/J": 140})"
           "\n");
  make_run("two", 2, 8, "{\"time_s\": 95, \"env_fra");  // it continues
  make_run("none", 3, 0);
  const Ending svg =
      plot({"one", "both=one,two", "none", "-o", path("curves.svg"), "--baseline", "random=90"});
  ASSERT_EQ(svg.exit_code, 0) << svg.err;
  EXPECT_EQ(svg.out, path("curves.svg") + "\n");
  EXPECT_THAT(svg.err,
              AllOf(HasSubstr("none: no episode has ended in 10 reports; left out"), Not(HasSubstr("two:"))));
  const std::string drawn = read_text(path("curves.svg"));
  EXPECT_THAT(drawn, AllOf(HasSubstr("<svg"), HasSubstr("one, evaluated"), HasSubstr("both (mean of 2)"),
                           HasSubstr("random"), Not(HasSubstr("<!-- none"))));

  const Ending png =
      plot({"one", path("two"), "--over_seeds", "--x", "time_s", "--output", path("curves.png")});
  ASSERT_EQ(png.exit_code, 0) << png.err;
  EXPECT_THAT(read_text(path("curves.png")), StartsWith("\x89PNG"));
}

TEST_F(Plot, DrawsTheRunsOfASweepOverTheirSeedsAndNamesThoseThatHaveNotBegun) {
  const auto planned = [](const char* name, const char* seed) {
    return nlohmann::json{{"name", name},
                          {"settings", {{"scenario", "lava_pit"}, {"algo", "ippo"}, {"seed", seed}}}};
  };
  folder_.write("study/sweep.json",
                nlohmann::json{{"runs", {planned("a", "1"), planned("b", "2"), planned("c", "3")}},
                               {"results", {{"folder", path("kept")}}}}
                    .dump());
  make_run("study/a", 1, 10);
  make_run("kept/b", 2, 10);
  make_run("other", 1, 10);
  const Ending swept = plot({"study", "other", "both=study", "-o", path("curves.svg")});
  ASSERT_EQ(swept.exit_code, 0) << swept.err;
  EXPECT_THAT(swept.err, HasSubstr("c: it was never started; left out"));
  EXPECT_THAT(read_text(path("curves.svg")),
              AllOf(HasSubstr("lava_pit IPPO (mean of 2)"), HasSubstr("both (mean of 2)"),
                    HasSubstr("<!-- other -->")));

  std::filesystem::create_directory(path("empty"));
  const Ending empty = plot({"empty", "-o", path("none.svg")});
  EXPECT_EQ(empty.exit_code, 2);
  EXPECT_THAT(empty.err,
              AllOf(HasSubstr(path("empty") + " holds no run yet; a run is a folder with config.toml"),
                    HasSubstr("start a run with comrad train")));
}

// What plot.py itself refuses: tests/unit/deploy/report.
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
           {{"one", "--x", "frames"}, "unknown axis 'frames'"}}) {
    std::vector<std::string> all = words;
    if (std::ranges::find(all, "-o") == all.end()) all.insert(all.end(), {"-o", path("a.png")});
    const Ending ending = plot(all);
    EXPECT_EQ(ending.exit_code, 2) << message;
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_FALSE(std::filesystem::exists(path("a.png"))) << message;
  }
}

class Export : public WithRuns {
 protected:
  Ending exported(const std::vector<std::string>& words, const Environment& environment = {}) {
    return run("export", words, environment);
  }
  std::vector<std::string> lines_of(const std::string& name) const {
    std::vector<std::string> lines;
    std::istringstream text(read_text(path(name)));
    for (std::string line; std::getline(text, line);) lines.push_back(line);
    return lines;
  }
};

TEST_F(Export, OneTableHoldsTheReportsOfAllRuns) {
  make_run("study/one", 1, 9,
           R"({"time_s": 50, "env_frames": 5000, "decisions": 1250, "eval/J": 140})"
           "\n");
  // The learner went back to 6000 env frames; a line was cut; a number was not finite.
  make_run("study/two", 2, 10,
           "{\"time_s\": 91, \"env_fra\n"
           R"({"time_s": 65, "env_frames": 6500, "train/entropy": null, "train/lr": 0.25})"
           "\n[1, 2]\n");
  make_run("other/two", 3, 10);
  folder_.write("empty/config.toml", "scenario = \"lava_pit\"\nalgo = \"ippo\"\nseed = 1\n");
  folder_.write("empty/metrics.jsonl", "");
  const Ending done = exported({"study", path("other/two"), "empty", "--csv", path("all.csv")});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  EXPECT_EQ(done.out, path("all.csv") + "\n");
  EXPECT_THAT(done.err,
              AllOf(HasSubstr("study/two: metrics.jsonl: 2 damaged lines skipped (lines 11, 13)"),
                    HasSubstr("empty: it has written no report yet; left out"), Not(HasSubstr("one:"))));
  const std::vector<std::string> lines = lines_of("all.csv");
  ASSERT_EQ(lines.size(), 1u + 11 + 8 + 10);
  EXPECT_EQ(lines[0],
            "run,scenario,algo,seed,time_s,env_frames,decisions,eval/J,policy_stats/avg_true_objective,train/"
            "entropy,train/lr");
  EXPECT_EQ(lines[1], "one,lava_pit,ippo,1,0,0,,,,1.0,") << "no episode had ended";
  EXPECT_EQ(lines[2], "one,lava_pit,ippo,1,10,1000,,,101,0.5,");
  EXPECT_THAT(lines, ::testing::Contains("one,lava_pit,ippo,1,50,5000,1250,140,,,"));
  EXPECT_THAT(lines, ::testing::Contains("study/two,lava_pit,ippo,2,65,6500,,,,,0.25"));
  EXPECT_THAT(lines, ::testing::Contains(::testing::StartsWith("other/two,lava_pit,ippo,3,")));
  EXPECT_THAT(lines, Not(::testing::Contains(HasSubstr(",2,70,7000,")))) << "what was forgotten";
  EXPECT_FALSE(std::filesystem::exists(path("all.csv.part")));
}

TEST_F(Export, RefusesWhatItCannotWrite) {
  make_run("one", 1, 10);
  folder_.write("empty/config.toml", "scenario = \"lava_pit\"\nalgo = \"ippo\"\nseed = 1\n");
  folder_.write("a_file", "");
  for (const auto& [words, message] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--csv", path("a.csv")}, "name a run"},
           {{"one"}, "--csv FILE or --wandb FOLDER"},
           {{"one", "--csv", path("a.csv"), "--wandb", path("w")}, "--csv FILE or --wandb FOLDER"},
           {{"ona", "--csv", path("a.csv")}, "did you mean 'one'?"},
           {{"one", "--csv", path("a.txt")}, ".csv"},
           {{"one", "--csv", path("no/a.csv")}, "is no folder"},
           {{"one", "--wandb", path("a_file")}, "it is a file"},
           {{"empty", "--csv", path("a.csv")}, "nothing to export"}}) {
    const Ending ending = exported(words);
    EXPECT_EQ(ending.exit_code, 2) << message;
    EXPECT_THAT(ending.err, HasSubstr(message));
    EXPECT_FALSE(std::filesystem::exists(path("a.csv"))) << message;
  }
}

TEST_F(Export, ReportsHowToInstallWandbWhereItIsMissing) {
  make_run("one", 1, 10);
  folder_.write("without/wandb.py", "raise ImportError('as if it were not installed')\n");
  const Ending ending = exported({"one", "--wandb", path("w")}, {{"PYTHONPATH", path("without")}});
  EXPECT_EQ(ending.exit_code, 2);
  EXPECT_THAT(ending.err, HasSubstr("ENV/bin/pip install wandb"));
  EXPECT_EQ(std::ranges::count(ending.err, '\n'), 1) << ending.err;
  EXPECT_FALSE(std::filesystem::exists(path("w")));
}

// What wandb is asked to do, written down by a module in its place.
TEST_F(Export, GivesWandbTheSettingsAndTheReportsOfEachRun) {
  make_run("one", 1, 10,
           R"({"time_s": 95, "env_frames": 9500, "decisions": 2375, "eval/J": 140, "eval/J_share": null})"
           "\n");
  folder_.write("one/videos/video_000000009500.gif", "GIF89a");
  folder_.write("stand_in/wandb.py", R"(
import json, os, pathlib
def Video(path): return "video " + pathlib.Path(path).name
class Run:
    def __init__(self, **words):
        self.calls = {"init": words, "mode": os.environ["WANDB_MODE"], "define": [], "log": []}
        self.dir = str(pathlib.Path(words["dir"]) / "wandb" / "offline-run-1" / "files")
    def define_metric(self, name, step_metric=None): self.calls["define"].append([name, step_metric])
    def log(self, values): self.calls["log"].append(values)
    def finish(self):
        pathlib.Path(self.dir).mkdir(parents=True)
        (pathlib.Path(self.dir) / "calls.json").write_text(json.dumps(self.calls))
def init(**words): return Run(**words)
)");
  const Ending done =
      exported({"one", "--wandb", path("w"), "--project", "team"}, {{"PYTHONPATH", path("stand_in")}});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  EXPECT_EQ(done.out, path("w/wandb/offline-run-1") + "\n");
  const auto told = nlohmann::json::parse(read_text(path("w/wandb/offline-run-1/files/calls.json")));
  EXPECT_EQ(told["mode"], "offline");
  EXPECT_EQ(told["init"]["mode"], "offline");
  EXPECT_EQ(told["init"]["project"], "team");
  EXPECT_EQ(told["init"]["name"], "one");
  EXPECT_EQ(told["init"]["group"], "lava_pit");
  EXPECT_EQ(told["init"]["config"]["algo"], "ippo");
  EXPECT_EQ(told["define"][1], (nlohmann::json{"*", "env_frames"}));
  ASSERT_EQ(told["log"].size(), 12u);
  EXPECT_EQ(told["log"][1]["env_frames"], 1000);
  EXPECT_EQ(told["log"][10]["eval/J"], 140);
  EXPECT_FALSE(told["log"][10].contains("eval/J_share")) << "it is null";
  EXPECT_EQ(told["log"][11],
            (nlohmann::json{{"env_frames", 9500}, {"eval/video", "video video_000000009500.gif"}}));
}

TEST_F(Export, WandbItselfMakesAnOfflineRun) {
  const Expected<std::string> python = test::python_with("wandb");
  if (!python) GTEST_SKIP() << python.error().message;
  make_run("one", 1, 10);
  folder_.write("one/videos/video_000000009500.gif", "GIF89a");
  const std::string bin = std::filesystem::path(*python).parent_path().string();
  const Ending done = exported({"one", "--wandb", path("w")},
                               {{"PATH", bin + ":" + std::getenv("PATH")}, {"HOME", path("home")}});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  const std::filesystem::path made = done.out.substr(0, done.out.find('\n'));
  EXPECT_THAT(made.string(), StartsWith(path("w/wandb/offline-run-")));
  std::string run;
  for (const auto& entry : std::filesystem::directory_iterator(made))
    if (entry.path().extension() == ".wandb") run = read_text(entry.path());
  for (const char* part : {"lava_pit", "train/entropy", "policy_stats/avg_true_objective"})
    EXPECT_THAT(run, HasSubstr(part));
  EXPECT_THAT(files((made / "files/media/videos/eval").string(), "video_"), ::testing::SizeIs(1));
}

}  // namespace plot_test
}  // namespace comrad::test
