// `comrad sweep` on this machine: real processes, of games in the last case alone.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

#include "tests/integration/running_program.h"

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

TEST(Sweep, MakesEveryRunOnCoresOfItsOwnAndOnlyOnce) {
  const ScratchFolder scratch;
  const std::string file =
      sweep_file(scratch, "1, 2, 3", "2000", "report = \"ls -d {folder} > report.txt; echo told\"\n");
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
  EXPECT_EQ(read_text(scratch / "study/records/report.log"), "told\n");
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
  EXPECT_EQ(read_text(scratch / "results/seed1/metrics.jsonl"),
            "{\"time_s\":1.5,\"env_frames\":100,\"train/loss\":0.12346}\n");
  const std::string settings = read_text(scratch / "results/seed1/config.toml");
  EXPECT_THAT(settings, AllOf(HasSubstr("seed = 1\n"), Not(HasSubstr(scratch.string()))));
  EXPECT_THAT(settings, Not(HasSubstr("gamma"))) << "a built-in value";
  EXPECT_THAT(result["command"], StartsWith("./comrad train --train_dir train_dir --experiment seed1 --"));
  EXPECT_EQ(read_json(scratch / "results/eval/seed1.json").dump(),
            R"({"J_mean":2.0,"each":[{"J":1.0,"return":0.25},{"J":3.0,"return":0.75}],"episodes":2,)"
            R"("map_hashes":{"seed 42":"xxh3:1"},"policy":"seed1","return_mean":0.5,"scenario":"field"})");

  EXPECT_EQ(read_json(scratch / "results/eval/random_field.json")["policy"], "random");

  // The runs are gone, as in another clone; what was kept is enough, and only what is missing is made.
  fs::remove_all(scratch / "study");
  const Ending clone = start(file("1, 2, 3", "2000"));
  EXPECT_EQ(clone.exit_code, 0) << clone.err;
  EXPECT_THAT(clone.out, HasSubstr("3 of 3 finished"));
  EXPECT_EQ(count(events(scratch), "begins"), 1);
  EXPECT_EQ(count(events(scratch), "seed3 begins"), 1);
  // A farther goal asks for more than was kept.
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
  // The same command makes the failed ones again; the killed one goes on where it was.
  const Ending again = start(file);
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_EQ(state_of(scratch, "seed700"), "finished");
  EXPECT_EQ(count(events(scratch), "seed600 fails"), 2);
  EXPECT_EQ(count(events(scratch), "seed1 begins"), 1);
}

TEST(Sweep, GoesOnAfterASigkillInTheMiddle) {
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
  EXPECT_EQ(count(events(scratch), "begins 0 "), 3) << events(scratch);  // two went on from where they were
  EXPECT_EQ(count(events(scratch), "meets another"), 0);
  for (const char* run : {"seed1", "seed2", "seed3"}) EXPECT_EQ(state_of(scratch, run), "finished") << run;
}

TEST(Sweep, StopSavesAndStatusTellsWhatIsThere) {
  const ScratchFolder scratch;
  const std::string file = sweep_file(scratch, "1, 2, 3", "100000");
  RunningProgram sweep({COMRAD_SWEEP_PROBE, "start", file});
  ASSERT_TRUE(wait_until([&] { return count(events(scratch), "begins 0") == 2; }));
  // A run begins before it has told its rate for the first time.
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
