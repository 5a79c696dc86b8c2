// `comrad sweep` on this machine: real processes, of games in the last case alone.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <memory>
#include <set>
#include <sstream>

#include "tests/integration/running_program.h"
#include "tests/support/test_python.h"

namespace comrad::test {
namespace sweep_test {

using ::testing::AllOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
namespace fs = std::filesystem;

/// A sweep of the stand-in: `seeds` are its runs, `more` further lines.
std::string sweep_file(const ScratchFolder& scratch, const std::string& seeds, const std::string& frames,
                       const std::string& more = "") {
  return scratch.write("study.toml",
                       "name = \"study\"\ntrain_dir = \"" + scratch.string() + "\"\n" + more +
                           "[axes]\nseed = [" + seeds + "]\n[settings]\nscenario = \"field\"\n" +
                           "train_for_env_frames = " + frames +
                           "\n[resources]\ncores = 1\nmemory_gb = 0.01\n[local]\nat_once = 2\n");
}

Ending start(const std::string& file) { return RunningProgram({COMRAD_SWEEP_PROBE, "start", file}).wait(); }

std::string events(const ScratchFolder& scratch) { return read_text(scratch / "study/events.log"); }

int count(const std::string& text, const std::string& part) {
  int found = 0;
  for (std::size_t place = text.find(part); place != std::string::npos; place = text.find(part, place + 1))
    ++found;
  return found;
}

std::string state_of(const ScratchFolder& scratch, const std::string& run) {
  const nlohmann::json record = read_json(scratch / ("study/records/" + run + ".json"));
  return record.is_object() ? record.value("state", "none") : "none";
}

TEST(Sweep, MakesEveryRunOnSeparateCoresAndOnlyOnce) {
  const ScratchFolder scratch;
  const std::string file =
      sweep_file(scratch, "1, 2, 3", "2000", "report = \"ls -d {folder} > report.txt; echo reported\"\n");
  const Ending first = start(file);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_THAT(first.out, HasSubstr("3 of 3 finished"));
  EXPECT_EQ(count(events(scratch), "ends finished 2000"), 3);
  EXPECT_EQ(count(events(scratch), "meets another"), 0);
  std::istringstream lines(events(scratch));
  for (std::string line; std::getline(lines, line);)
    if (line.find("begins") != std::string::npos) {
      EXPECT_THAT(line, Not(ContainsRegex("cpus [0-9]+,")));
    }
  EXPECT_EQ(read_text(scratch / "study/report.txt"), (scratch / "study").string() + "\n");
  EXPECT_EQ(read_text(scratch / "study/records/report.log"), "reported\n");
  const nlohmann::json index = read_json(scratch / "study/sweep.json");
  EXPECT_EQ(index["runs"].size(), 3u);
  EXPECT_FALSE(index["starts"][0]["host"].get<std::string>().empty());

  const Ending second = start(file);
  EXPECT_EQ(second.exit_code, 0) << second.err;
  EXPECT_EQ(count(events(scratch), "begins"), 3);  // nothing was made again
  // More seeds and a farther goal: what is new, and what is missing of the old ones.
  const Ending third = start(sweep_file(scratch, "1, 2, 3, 4", "3000"));
  EXPECT_EQ(third.exit_code, 0) << third.err;
  EXPECT_EQ(count(events(scratch), "begins 2000"), 3);
  EXPECT_EQ(count(events(scratch), "begins 0"), 4);
}

TEST(Sweep, ResultsAreKeptAndAnotherCloneDoesNotMakeThemAgain) {
  const ScratchFolder scratch;
  const std::string results = (scratch / "results").string();
  const auto file = [&](const std::string& seeds, const std::string& frames) {
    return sweep_file(scratch, seeds, frames, "[results]\nfolder = \"" + results + "\"\nepisodes = 2\n");
  };
  const Ending first = start(file("1, 2, 500", "2000"));
  EXPECT_EQ(first.exit_code, 1);
  EXPECT_THAT(first.out, HasSubstr("2 of 3 finished, 1 failed"));
  EXPECT_THAT(first.out,
              HasSubstr("seed500 failed: it finished, but its result could not be kept: the evaluation"));
  const nlohmann::json result = read_json(scratch / "results/seed1/result.json");
  ASSERT_TRUE(result.is_object());
  EXPECT_EQ(result["J_mean"], 2.0);
  EXPECT_EQ(result["train_for_env_frames"], 2000);
  EXPECT_EQ(result["map_hashes"]["seed 42"], "xxh3:1");
  EXPECT_EQ(result["commit"], read_json(scratch / "study/records/seed1.json")["commit"]) << "of its start";
  EXPECT_EQ(read_text(scratch / "results/seed1/curve.csv"), "env_frames,J\n100,0.12346\n");
  const std::string settings = read_text(scratch / "results/seed1/config.toml");
  EXPECT_THAT(settings, AllOf(HasSubstr("seed = 1\n"), Not(HasSubstr(scratch.string()))));
  EXPECT_THAT(settings, Not(HasSubstr("gamma"))) << "a built-in value";
  EXPECT_THAT(result["command"], StartsWith("./comrad train --train_dir train_dir --experiment seed1 --"));
  EXPECT_EQ(result["J"], (nlohmann::json{1.0, 3.0})) << "five digits of each episode";
  EXPECT_EQ(result["return"], (nlohmann::json{0.25, 0.75}));
  EXPECT_EQ(result["J_mean_greedy"], 4.0);
  EXPECT_FALSE(result.contains("checkpoint")) << "a path of this machine";
  EXPECT_EQ(read_json(scratch / "results/random_field.json")["policy"], "random");

  // The runs are gone, as in another clone; what was kept is enough, and only what is missing is made.
  fs::remove_all(scratch / "study");
  const Ending clone = start(file("1, 2, 3", "2000"));
  EXPECT_EQ(clone.exit_code, 0) << clone.err;
  EXPECT_THAT(clone.out, HasSubstr("3 of 3 finished"));
  EXPECT_EQ(count(events(scratch), "begins"), 1);
  EXPECT_EQ(count(events(scratch), "seed3 begins"), 1);
  // A farther goal requests more than was kept.
  const Ending more = start(file("1", "3000"));
  EXPECT_EQ(more.exit_code, 0) << more.err;
  EXPECT_EQ(read_json(scratch / "results/seed1/result.json")["train_for_env_frames"], 3000);
}

TEST(Sweep, AFailedRunIsNamedWithItsErrorAndStopsNoOther) {
  const ScratchFolder scratch;
  const std::string file = sweep_file(scratch, "600, 1, 700, 2", "2000");
  const Ending ending = start(file);
  EXPECT_EQ(ending.exit_code, 1);
  EXPECT_THAT(ending.err, HasSubstr("seed600 failed: seed 600 is unlucky"));
  EXPECT_THAT(ending.out, HasSubstr("seed700 failed: comrad train was killed by signal 9 (Killed)"));
  EXPECT_THAT(ending.out, HasSubstr("2 of 4 finished, 2 failed"));
  const std::string log = read_text(scratch / "study/records/seed600.log");
  EXPECT_THAT(log, HasSubstr("something before"));
  // The same command makes the failed ones again; the killed one continues where it was.
  const Ending again = start(file);
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_EQ(state_of(scratch, "seed700"), "finished");
  EXPECT_EQ(count(events(scratch), "seed600 fails"), 2);
  EXPECT_EQ(count(events(scratch), "seed1 begins"), 1);
}

TEST(Sweep, ContinuesAfterASigkillInTheMiddle) {
  const ScratchFolder scratch;
  const std::string file = sweep_file(scratch, "1, 2, 3", "100000");
  {
    RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", file});
    ASSERT_TRUE(wait_until([&] { return count(events(scratch), "begins 0") == 2; }));
    const Ending second = start(file);  // one at a time
    EXPECT_EQ(second.exit_code, 2);
    EXPECT_THAT(second.err, HasSubstr("at work already (pid " + std::to_string(sweep.pid())));
    sweep.signal(SIGKILL);
    sweep.wait();
  }
  // The runs hear of it and save; meanwhile every file can be read.
  const nlohmann::json index = read_json(scratch / "study/sweep.json");
  ASSERT_TRUE(index.is_object());
  EXPECT_EQ(index["runs"].size(), 3u);
  const Ending rest = start(sweep_file(scratch, "1, 2, 3", "6000"));  // within reach now
  EXPECT_EQ(rest.exit_code, 0) << rest.err << rest.out;
  EXPECT_EQ(count(events(scratch), "ends paused"), 2) << events(scratch);
  EXPECT_EQ(count(events(scratch), "begins 0 "), 3) << events(scratch);  // two continued from where they were
  EXPECT_EQ(count(events(scratch), "meets another"), 0);
  for (const char* run : {"seed1", "seed2", "seed3"}) EXPECT_EQ(state_of(scratch, run), "finished") << run;
}

TEST(Sweep, StopSavesAndStatusReportsWhatExists) {
  const ScratchFolder scratch;
  const std::string file = sweep_file(scratch, "1, 2, 3", "100000");
  RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", file});
  ASSERT_TRUE(wait_until([&] { return count(events(scratch), "begins 0") == 2; }));
  // A run begins before its first report of its rate.
  ASSERT_TRUE(wait_until([&] { return fs::exists(scratch / "study/seed1/status.json"); }));
  const Ending status = comrad({"sweep", "status", file, "--json"});
  ASSERT_EQ(status.exit_code, 0) << status.err;
  const nlohmann::json seen = nlohmann::json::parse(status.out, nullptr, false);
  ASSERT_TRUE(seen.is_object()) << status.out;
  EXPECT_EQ(seen["running"], 2);
  EXPECT_EQ(seen["waiting"], 1);
  EXPECT_EQ(seen["runs"][0]["env_frames_per_s"], 5000);
  EXPECT_THAT(comrad({"sweep", "status", "study", "--train_dir", scratch.string()}).out,
              ContainsRegex("seed1 +running +[0-9.k]+/100k .* 5k .*ETA|seed1 +running"));
  const Ending stop = comrad({"sweep", "stop", "study", "--train_dir", scratch.string()});
  EXPECT_EQ(stop.exit_code, 0) << stop.err;
  EXPECT_EQ(sweep.wait().exit_code, 0);
  EXPECT_EQ(count(events(scratch), "ends paused"), 2);
  EXPECT_EQ(state_of(scratch, "seed1"), "interrupted");
  EXPECT_THAT(comrad({"sweep", "logs", "seed1", "--train_dir", scratch.string()}).out,
              HasSubstr("== attempt 1 on "));
  const Ending unknown = comrad({"sweep", "status", "studi", "--train_dir", scratch.string()});
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("did you mean 'study'?"));
}

TEST(Sweep, RefusesBeforeAnythingStarts) {
  const ScratchFolder scratch;
  const std::string file =
      scratch.write("bad.toml", "name = \"bad\"\ntrain_dir = \"" + scratch.string() +
                                    "\"\n[axes]\nscenario = [\"lava_pit\", \"lava_pti\"]\n");
  const Ending ending = comrad({"sweep", file});
  EXPECT_EQ(ending.exit_code, 2);
  EXPECT_THAT(ending.err, AllOf(HasSubstr("bad.toml:4: "), HasSubstr("lava_pit")));
  EXPECT_FALSE(fs::exists(scratch / "bad"));
}

TEST(Sweep, DryRunRefusesWhatTrainRefusesAndShowsTheBatchScript) {
  const ScratchFolder scratch;
  const auto dry_run = [&](const std::string& algo, const std::string& rest) {
    return comrad({"sweep", "--dry_run",
                   scratch.write("dry.toml", "name = \"dry\"\ntrain_dir = \"" + scratch.string() + R"("
backend = "slurm"
[axes]
algo = [")" + algo + R"("]
[settings]
scenario = "lava_pit"
)" + rest + R"(
[resources]
cores = 2
memory_gb = 4
[slurm]
partition = "short"
)")});
  };
  const Ending good = dry_run("ippo", "");
  ASSERT_EQ(good.exit_code, 0) << good.err;
  EXPECT_THAT(good.out, AllOf(HasSubstr("train --train_dir"), HasSubstr("#SBATCH --partition=short"),
                              HasSubstr("#SBATCH --array=0-0"), HasSubstr("sweep element")));
  const Ending too_short = dry_run("vdn", "train_for_env_frames = 1000");
  EXPECT_EQ(too_short.exit_code, 2);
  EXPECT_THAT(too_short.err,
              AllOf(HasSubstr("dry.toml:8: "), HasSubstr("vdn cannot run: learning begins at")));
  const Ending unknown = dry_run("ippo", "encoder_conv_architecture = \"mynet\"");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("mynet"));
  EXPECT_FALSE(fs::exists(scratch / "dry"));
}

/// Searches of the stand-in, whose score is 1000 times its learning rate.
class SweepSearch : public ::testing::Test {
 protected:
  void SetUp() override {
    const Expected<std::string> python = python_with("optuna");
    if (!python) GTEST_SKIP() << python.error().message;
    environment_ = {{"COMRAD_SEARCH_PYTHON", *python}};
  }
  /// `search`: further lines of [search]; `more`: of [settings].
  std::string file(const std::string& method, const std::string& search, const std::string& frames,
                   int at_once = 2, const std::string& more = "") const {
    return scratch_.write(
        "study.toml",
        "name = \"study\"\ntrain_dir = \"" + scratch_.string() + "\"\n[settings]\nscenario = \"field\"\n" +
            more + "train_for_env_frames = " + frames + "\n[search]\nmethod = \"" + method + "\"\n" + search +
            "\n[search.space]\nlearning_rate = {low = 1e-4, high = 1e-1, log = true}\n" +
            "exploration_loss = [\"entropy\", \"none\"]\n[resources]\ncores = 1\n" +
            "memory_gb = 0.01\n[local]\nat_once = " + std::to_string(at_once) + "\n");
  }
  Ending start(const std::string& file) const {
    return RunningProgram({COMRAD_SWEEP_PROBE, "start", file}, environment_).wait();
  }
  nlohmann::json record(const std::string& run) const {
    return read_json(scratch_ / ("study/records/" + run + ".json"));
  }
  std::string events() const { return sweep_test::events(scratch_); }
  nlohmann::json generations(const std::string& member) const {
    return read_json(scratch_ / ("study/search/" + member + ".json"))["generations"];
  }
  /// Trials that the study holds: Optuna's operation 4 makes one.
  int trials() const { return count(read_text(study_), "\"op_code\":4,"); }

  const ScratchFolder scratch_;
  const fs::path study_ = scratch_ / "study/search/study.log";
  Environment environment_;
};

TEST_F(SweepSearch, TrialsAtOnceShareAStudyAndTheBestIsNamed) {
  for (const char* method : {"random", "tpe"}) {
    fs::remove_all(scratch_ / "study");
    const std::string path = file(method, "trials = 4", "1000");
    const Ending first = start(path);
    ASSERT_EQ(first.exit_code, 0) << first.err;
    EXPECT_EQ(count(events(), "ends finished 1000"), 4);
    std::set<std::string> rates;
    std::string best;
    double highest = 0;
    for (const char* run : {"trial_001", "trial_002", "trial_003", "trial_004"}) {
      const std::string rate = record(run)["searched"]["learning_rate"];
      rates.insert(rate);
      if (std::stod(rate) > highest) highest = std::stod(rate), best = run;
    }
    EXPECT_EQ(rates.size(), 4u);
    EXPECT_EQ(trials(), 4);
    EXPECT_THAT(first.out, HasSubstr("best of study: " + best + ", J "));
    const Ending again = start(path);
    EXPECT_EQ(again.exit_code, 0);
    EXPECT_EQ(count(events(), "begins"), 4) << "nothing is made again";
    const nlohmann::json seen =
        nlohmann::json::parse(comrad({"sweep", "status", path, "--json"}).out, nullptr, false);
    EXPECT_EQ(seen["runs"][1]["searched"], record("trial_002")["searched"]);
  }
  const Ending more = start(file("tpe", "trials = 5", "1000"));
  EXPECT_EQ(more.exit_code, 0) << more.err;
  EXPECT_EQ(count(events(), "begins"), 5);
  for (const auto& other : {file("random", "trials = 5", "1000"), file("tpe", "trials = 5\nseed = 3", "1000"),
                            file("tpe", "trials = 5", "2000")}) {
    const Ending changed = start(other);
    EXPECT_EQ(changed.exit_code, 2);
    EXPECT_THAT(changed.err, HasSubstr("study.toml:6: [search] has begun"));
  }
}

TEST_F(SweepSearch, HalvingEndsTheWorseTrialsEarly) {
  const Ending ending = start(file("halving", "trials = 7\nfirst_env_frames = 300", "2700", 1));
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.out, AllOf(HasSubstr("7 of 7 finished"), HasSubstr("finished, pruned")));
  int pruned = 0;
  for (int run = 1; run <= 7; ++run) {
    const nlohmann::json one = record("trial_00" + std::to_string(run));
    const double at = one["pruned_at_env_frames"];
    EXPECT_EQ(one["state"], "finished");
    EXPECT_THAT(at, ::testing::AnyOf(0, 300, 900));
    pruned += at > 0;
    if (at == 0) {
      EXPECT_EQ(env_frames(scratch_ / ("study/trial_00" + std::to_string(run))), 2700);
    }
  }
  EXPECT_GE(pruned, 3);
  EXPECT_THAT(events(), AllOf(HasSubstr("trial_001 begins 300 from trial_001"),
                              HasSubstr("trial_001 begins 900 from")));
  EXPECT_EQ(trials(), 7);
}

TEST_F(SweepSearch, AKilledElementResumesItsTrial) {
  const std::string path = file("tpe", "trials = 3", "12000");
  nlohmann::json before;
  {
    RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", path}, environment_);
    ASSERT_TRUE(wait_until([&] { return count(events(), "begins 0") == 2; }));
    before = record("trial_001");
    ASSERT_EQ(kill(before["pid"].get<pid_t>(), SIGKILL), 0);
    ASSERT_TRUE(wait_until([&] { return count(events(), "trial_001 ends paused") == 1; }))
        << "it dies with its element";
    sweep.signal(SIGTERM);
    EXPECT_EQ(sweep.wait().exit_code, 0);
  }
  const Ending rest = start(path);
  ASSERT_EQ(rest.exit_code, 0) << rest.err << rest.out;
  EXPECT_EQ(record("trial_001")["searched"], before["searched"]);
  EXPECT_EQ(record("trial_001")["trial"], before["trial"]);
  EXPECT_EQ(trials(), 3);
  EXPECT_EQ(count(events(), "begins 0 "), 3) << events();
  EXPECT_EQ(count(events(), "meets another"), 0);
}

TEST_F(SweepSearch, AMissingOrDamagedStudyIsAnErrorAndNothingIsTrained) {
  const std::string path = file("tpe", "trials = 2", "100000");
  {
    RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", path}, environment_);
    ASSERT_TRUE(wait_until([&] { return count(events(), "begins 0") == 2; }));
    sweep.signal(SIGTERM);
    EXPECT_EQ(sweep.wait().exit_code, 0);
  }
  const std::string study = read_text(study_);
  const int begun = count(events(), "begins");
  fs::remove(study_);
  const Ending missing = start(path);
  EXPECT_NE(missing.exit_code, 0);
  EXPECT_THAT(missing.err, AllOf(HasSubstr("the study file " + study_.string() +
                                           " is missing, which has chosen the settings of"),
                                 HasSubstr("restore it")));
  for (const std::string& damaged : {"rubbish\n" + study, study.substr(0, study.size() - 5)}) {
    scratch_.write("study/search/study.log", damaged);
    const Ending ending = start(path);
    EXPECT_NE(ending.exit_code, 0);
    EXPECT_THAT(ending.err, HasSubstr("the study file " + study_.string()));
    // What Slurm starts later sees it, too.
    const Ending element =
        RunningProgram({COMRAD_SWEEP_PROBE, "sweep", "element", (scratch_ / "study").string(), "trial_001"},
                       environment_)
            .wait();
    EXPECT_EQ(element.exit_code, 1);
    EXPECT_THAT(record("trial_001")["error"].get<std::string>(),
                HasSubstr("the study file " + study_.string()));
  }
  EXPECT_EQ(count(events(), "begins"), begun);
  scratch_.write("study/search/study.log", study);
  RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", path}, environment_);
  EXPECT_TRUE(wait_until([&] { return count(events(), "begins") == begun + 2; }));
  sweep.signal(SIGTERM);
  sweep.wait();
}

TEST_F(SweepSearch, AFailedTrialIsReportedAndMadeAgainWithItsSettings) {
  const std::string path =
      file("tpe", "trials = 1", "2000", 1, "seed = 700\n");  // killed after 1000 frames, once
  const Ending failed = start(path);
  EXPECT_EQ(failed.exit_code, 1);
  const nlohmann::json before = record("trial_001");
  EXPECT_EQ(before["state"], "failed");
  const Ending again = start(path);
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(record("trial_001")["searched"], before["searched"]);
  EXPECT_EQ(trials(), 2) << "the failed one, and the one that was finished";
}

TEST_F(SweepSearch, MembersOfAPopulationTakeTurnsAndTheWorstCopiesTheBest) {
  const std::string path = file("pbt", "members = 4\nevery_env_frames = 500\nseed = 1", "2000", 1);
  {
    RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", path}, environment_);
    ASSERT_TRUE(wait_until([&] { return count(events(), "begins") == 7; }));
    sweep.signal(SIGKILL);
    sweep.wait();
  }
  const Ending rest = start(path);
  ASSERT_EQ(rest.exit_code, 0) << rest.err << rest.out;
  EXPECT_THAT(rest.out, AllOf(HasSubstr("4 of 4 finished"), HasSubstr("best of study: member_")));
  std::vector<std::string> first_turns;
  std::istringstream lines(events());
  for (std::string line; std::getline(lines, line) && first_turns.size() < 4;)
    if (line.find("begins") != std::string::npos) first_turns.push_back(line.substr(0, 17));
  EXPECT_THAT(first_turns, ::testing::ElementsAre("member_1 begins 0", "member_2 begins 0",
                                                  "member_3 begins 0", "member_4 begins 0"));
  int copies = 0;
  for (int member = 1; member <= 4; ++member) {
    const std::string name = "member_" + std::to_string(member);
    const nlohmann::json done = generations(name);
    ASSERT_EQ(done.size(), 4u) << name;
    for (std::size_t number = 0; number < 4; ++number) {
      EXPECT_EQ(done[number]["env_frames"], 500 * (number + 1));
      EXPECT_NEAR(done[number]["score"],
                  1000 * std::stod(done[number]["settings"]["learning_rate"].get<std::string>()), 1e-9);
      const std::string kept = "study/search/" + name + "/" + std::to_string(number) + "/checkpoint_";
      const std::string frames = std::to_string(500 * (number + 1));
      EXPECT_TRUE(fs::exists(scratch_ / (kept + frames + "_" + frames + ".pt"))) << kept;
      const std::string parent = done[number]["parent"];
      if (parent.empty()) continue;
      ++copies;
      EXPECT_GT(generations(parent)[number - 1]["score"], done[number - 1]["score"]);
      EXPECT_THAT(events(), ContainsRegex(name + " begins " + std::to_string(500 * number) +
                                          " from [a-z0-9_,]*" + parent + " "));
      EXPECT_TRUE(fs::exists(scratch_ / ("study/" + name + "/checkpoint_" + std::to_string(number))))
          << "its own stays";
    }
  }
  EXPECT_EQ(copies, 3) << "the worst of four, after each generation but the last";
  EXPECT_EQ(count(events(), "meets another"), 0);
  // A farther goal: the population continues.
  const Ending farther = start(file("pbt", "members = 4\nevery_env_frames = 500\nseed = 1", "2500", 2));
  EXPECT_EQ(farther.exit_code, 0) << farther.err;
  EXPECT_EQ(generations("member_3").size(), 5u);
}

TEST_F(SweepSearch, MembersOnAClusterContinueByThemselvesAtOnce) {
  const std::string path = file("pbt", "members = 3\nevery_env_frames = 500", "1500", 1);
  {
    RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", path}, environment_);
    ASSERT_TRUE(wait_until([&] { return count(events(), "begins") == 1; }));
    sweep.signal(SIGTERM);
    sweep.wait();
  }
  std::vector<std::unique_ptr<RunningProgram>> elements;
  for (const char* member : {"member_1", "member_2", "member_3"})
    elements.push_back(std::make_unique<RunningProgram>(std::vector<std::string>{
        COMRAD_SWEEP_PROBE, "sweep", "element", (scratch_ / "study").string(), member}));
  for (const auto& element : elements) {
    const Ending ending = element->wait();
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
  }
  for (const char* member : {"member_1", "member_2", "member_3"}) {
    EXPECT_EQ(generations(member).size(), 3u) << member;
    EXPECT_EQ(record(member)["state"], "finished") << member;
  }
  scratch_.write("study/search/member_2.json", "{");
  fs::remove(scratch_ / "study/records/member_2.json");
  const Ending damaged = start(path);
  EXPECT_EQ(damaged.exit_code, 1);
  EXPECT_THAT(
      damaged.out,
      HasSubstr("member_2 failed: " + (scratch_ / "study/search/member_2.json").string() + " is damaged"));
}

TEST(Sweep, ASearchIsCheckedBeforeAnythingStarts) {
  const ScratchFolder scratch;
  const auto dry_run = [&](const std::string& method, const std::string& space) {
    return comrad({"sweep", "--dry_run",
                   scratch.write("dry.toml", "name = \"dry\"\ntrain_dir = \"" + scratch.string() + R"("
[settings]
scenario = "lava_pit"
train_for_env_frames = 1e6
[search]
)" + method + R"(
[search.space]
)" + space + "\n[resources]\ncores = 1\nmemory_gb = 1\n")},
                  {{"COMRAD_SEARCH_PYTHON", "/bin/false"}});
  };
  const std::string pbt = "method = \"pbt\"\nmembers = 2\nevery_env_frames = 1e5";
  const Ending good = dry_run(pbt, "gamma = {low = 0.9, high = 0.999}");
  ASSERT_EQ(good.exit_code, 0) << good.err;
  EXPECT_THAT(good.out,
              AllOf(HasSubstr("# pbt searches gamma: 0.9 to 0.999\n"), HasSubstr("--experiment member_2 ")));
  const Ending no_optuna = dry_run("method = \"tpe\"\ntrials = 2", "gamma = {low = 0.9, high = 0.999}");
  EXPECT_EQ(no_optuna.exit_code, 2);
  EXPECT_THAT(no_optuna.err, HasSubstr("[search] needs Optuna 4 or later"));
  const Ending unknown = dry_run(pbt, "gama = {low = 0.9, high = 0.999}");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("dry.toml:11: unknown setting 'gama'; did you mean 'gamma'?"));
  const Ending odd = dry_run("method = \"random\"\ntrials = 2", "encoder = [\"simple\", \"mynet\"]");
  EXPECT_EQ(odd.exit_code, 2);
  EXPECT_THAT(odd.err, AllOf(HasSubstr("dry.toml:10: "), HasSubstr("mynet")));
  EXPECT_FALSE(fs::exists(scratch / "dry"));
}

/// Three real runs that copy each other's checkpoints. J is a return, so no two are equal.
TEST(SweepPopulationLong, OfRealRunsCopiesCheckpointsAndSettings) {
  const ScratchFolder scratch;
  const std::string file =
      scratch.write("real.toml", "name = \"real\"\ntrain_dir = \"" + scratch.string() + R"("
[settings]
scenario = "armory_siege"
algo = "ippo"
num_envs_per_worker = 4
decision_limit = 16
stats_avg = 20
rollout = 16
batch_size = 128
micro_batch_size = 64
rnn_size = 32
device = "cpu"
train_for_env_frames = 18000
[search]
method = "pbt"
members = 3
every_env_frames = 6000
[search.space]
learning_rate = {low = 1e-5, high = 1e-2, log = true}
exploration_loss_coeff = {low = 1e-4, high = 1e-1, log = true}
[resources]
cores = 1
memory_gb = 1
)");
  const Ending ending = comrad({"sweep", file});
  ASSERT_EQ(ending.exit_code, 0) << ending.err << ending.out;
  EXPECT_THAT(ending.out, HasSubstr("3 of 3 finished"));
  int copies = 0;
  for (const char* member : {"member_1", "member_2", "member_3"}) {
    const nlohmann::json done =
        read_json(scratch / ("real/search/" + std::string(member) + ".json"))["generations"];
    ASSERT_EQ(done.size(), 3u) << member;
    for (const nlohmann::json& generation : done) {
      copies += !generation["parent"].get<std::string>().empty();
      EXPECT_TRUE(generation["score"].is_number());
    }
    EXPECT_THAT(
        read_text(scratch / ("real/" + std::string(member) + "/config.toml")),
        HasSubstr("learning_rate = " + done[2]["settings"]["learning_rate"].get<std::string>() + "\n"));
    EXPECT_GE(env_frames(scratch / ("real/" + std::string(member))), 18000);
    EXPECT_THAT(read_text(scratch / ("real/records/" + std::string(member) + ".log")),
                HasSubstr("Resuming the run in"));
  }
  EXPECT_EQ(copies, 2);
  EXPECT_TRUE(processes_of(scratch / "real").empty());
}

TEST(Sweep, OfRealRunsCanBeStoppedResumedAndSeen) {
  const ScratchFolder scratch;
  const auto file = [&](const std::string& frames) {
    return scratch.write("real.toml", "name = \"real\"\ntrain_dir = \"" + scratch.string() + R"("
[axes]
algo = ["ippo", "vdn"]
[settings]
scenario = "coop_health_gathering"
num_envs_per_worker = 2
rollout = 16
batch_size = 128
micro_batch_size = 64
rnn_size = 32
rnn_type = "gru"
learning_starts_decisions = 64
replay_ratio = 0.25
device = "cpu"
progress_interval = 1
experiment_summaries_interval = 1
train_for_env_frames = )" + frames + R"(
[resources]
cores = 1
memory_gb = 1
)");
  };
  const std::string first = file("1e8");
  {
    RunningProgram sweep({program("comrad"), "sweep", first});
    ASSERT_TRUE(wait_until([&] { return env_frames(scratch / "real/ippo") > 0; })) << sweep.wait().err;
    sweep.signal(SIGTERM);
    const Ending ending = sweep.wait();
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
  }
  EXPECT_EQ(read_json(scratch / "real/records/ippo.json")["state"], "interrupted");
  const double before = env_frames(scratch / "real/ippo");
  EXPECT_GT(before, 0);
  const std::string goal = std::to_string(static_cast<long>(before) + 4096);
  const Ending ending = comrad({"sweep", file(goal)});
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.out, HasSubstr("2 of 2 finished"));
  EXPECT_THAT(read_text(scratch / "real/records/ippo.log"), HasSubstr("Resuming the run in"));
  EXPECT_TRUE(processes_of(scratch / "real").empty());
  const Ending changed =
      comrad({"sweep", [&] {
                std::string text = read_text(first);
                const std::size_t place = text.find("rnn_size = 32");
                return scratch.write("real.toml", text.replace(place, 13, "rnn_size = 64"));
              }()});
  EXPECT_EQ(changed.exit_code, 2);
  EXPECT_THAT(changed.err,
              ContainsRegex("real.toml:[0-9]+: ippo is there already: .*the run was made with 32"));
}

}  // namespace sweep_test
}  // namespace comrad::test
