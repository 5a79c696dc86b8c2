#include "deploy/launch/supervisor.h"

#include <dirent.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "deploy/launch/progress.h"
#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace supervisor_test {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

std::string read_file(const std::string& path) {
  std::ifstream file(path);
  // A file of /proc cannot be read on once its process has ended; iterators would throw then.
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// What is true of real processes alone: what they are given, what reaches them, and that none is left. The supervisor's
/// decisions are played by tests/simulation.
///
/// A supervisor in its own process (launch_probe.cc) with fake workers (fake_worker.cc) in a
/// run directory.
class Launch : public testing::Test {
 protected:
  Launch() { fs::create_directories(run_dir_ + "/logs"); }
  void TearDown() override {
    if (probe_ > 0) {
      kill(probe_, SIGKILL);
      waitpid(probe_, nullptr, 0);
    }
    EXPECT_TRUE(test::wait_until([&] { return living_workers().empty(); }))
        << "workers outlived the supervisor";
  }

  void start(const std::string& habits, const std::vector<std::string>& options = {}) {
    std::ofstream(run_dir_ + "/fake.txt") << habits;
    std::vector<std::string> words = {COMRAD_LAUNCH_PROBE, run_dir_, COMRAD_FAKE_BIN};
    words.insert(words.end(), options.begin(), options.end());
    probe_ = fork();
    if (probe_ == 0) {
      dup2(open((run_dir_ + "/out.json").c_str(), O_WRONLY | O_CREAT, 0644), STDOUT_FILENO);
      dup2(open((run_dir_ + "/progress.txt").c_str(), O_WRONLY | O_CREAT, 0644), STDERR_FILENO);
      std::vector<char*> argv;
      for (std::string& word : words) argv.push_back(word.data());
      argv.push_back(nullptr);
      execv(argv[0], argv.data());
      _exit(127);
    }
  }

  /// Waits for the supervisor's end. Its exit code; -signal if it was killed; -1000 if it is still there.
  int wait_for_end() {
    int status = 0;
    const bool ended = test::wait_until([&] { return waitpid(probe_, &status, WNOHANG) == probe_; });
    if (!ended) return -1000;
    probe_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

  std::vector<std::string> events() const {
    std::vector<std::string> lines;
    std::ifstream file(run_dir_ + "/events.log");
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }
  /// Pids of all lives of one worker, or of all.
  std::vector<pid_t> pids(const std::string& worker) const {
    std::vector<pid_t> found;
    for (const std::string& event : events()) {
      std::istringstream words(event);
      std::string who, what;
      pid_t pid = 0;
      if (words >> who >> what >> pid && what == "start" && (worker.empty() || who == worker))
        found.push_back(pid);
    }
    return found;
  }
  std::vector<pid_t> living_workers() const {
    std::vector<pid_t> alive;
    for (const pid_t pid : pids("")) {
      // A pid that now belongs to another process is not ours.
      if (read_file("/proc/" + std::to_string(pid) + "/cmdline").find(run_dir_) != std::string::npos)
        alive.push_back(pid);
    }
    return alive;
  }
  bool is_running(const std::string& worker) const {
    const std::vector<std::string> all = events();
    return std::find(all.begin(), all.end(), worker + " running") != all.end();
  }
  bool all_run() const {
    return is_running("sim-0") && is_running("sim-1") && is_running("policy-0") && is_running("learner");
  }
  nlohmann::json outcome() const {
    return nlohmann::json::parse(read_file(run_dir_ + "/out.json"), nullptr, false);
  }
  nlohmann::json status() const {
    return nlohmann::json::parse(read_file(run_dir_ + "/status.json"), nullptr, false);
  }
  std::string progress() const { return read_file(run_dir_ + "/progress.txt"); }
  bool has_shown(const std::string& text) const { return progress().find(text) != std::string::npos; }

  /// Everything that helps to see why a run did not end: what was shown, logged and lived through, and where the threads of
  /// the supervisor and of its workers wait.
  std::string story() const {
    std::string text = progress();
    for (const char* file : {"/events.log", "/logs/supervisor.log", "/status.json"})
      text += std::string("\n") + file + ":\n" + read_file(run_dir_ + file);
    std::vector<pid_t> processes = living_workers();
    if (probe_ > 0) processes.push_back(probe_);
    for (const pid_t pid : processes) {
      const std::string tasks = "/proc/" + std::to_string(pid) + "/task";
      std::error_code gone;
      for (const auto& task : fs::directory_iterator(tasks, gone))
        text += task.path().string() + ": " + read_file(task.path() / "comm") + "  " +
                read_file(task.path() / "stat") + "  " + read_file(task.path() / "wchan") + "\n";
    }
    return text;
  }

  const test::ScratchFolder folder_;
  const std::string run_dir_ = folder_.string();
  pid_t probe_ = -1;
};

TEST_F(Launch, ARunEndsWhenTheLearnerHasFinished) {
  start("learner finish 4000\n");
  ASSERT_EQ(wait_for_end(), 0) << story();
  const nlohmann::json result = outcome();
  EXPECT_THAT(std::string(result["message"]),
              testing::MatchesRegex("finished: .* env frames in .*s, [0-9]+ env "
                                    "frames/s, [0-9]+ decisions/s, J 123.5; "
                                    "checkpoint checkpoint/fake.pt"));
  EXPECT_EQ(result["interrupted"], false);
  EXPECT_EQ(result["restarts"], 0);
  EXPECT_GT(result["learner_version"], 5);
  EXPECT_THAT(events(), testing::IsSupersetOf(
                            {"sim-0 stopped", "sim-1 stopped", "policy-0 stopped", "learner finished"}));
  EXPECT_EQ(status()["state"], "finished");
  EXPECT_EQ(status()["J_mean"], 123.5);
  EXPECT_GT(status()["env_frames"], 1000);
  EXPECT_THAT(progress(), HasSubstr("starting: "));
  EXPECT_THAT(progress(), HasSubstr("5120 env frames/s, 1280 decisions/s | J 123.5"));
  EXPECT_THAT(progress(), Not(HasSubstr("\x1b"))) << "plain lines when piped";
}

TEST_F(Launch, WorkersGetTheirCommandLinesAndThreadCounts) {
  start("learner finish 200\n");
  ASSERT_EQ(wait_for_end(), 0) << story();
  std::string all;
  for (const std::string& event : events()) all += event + "\n";
  EXPECT_THAT(all, testing::ContainsRegex("sim-1 start [0-9]+ --run_dir " + run_dir_ +
                                          " --arena comrad-[0-9a-f]+ --worker_index 1\n"));
  EXPECT_THAT(all, testing::ContainsRegex("policy-0 start [0-9]+ --run_dir " + run_dir_ +
                                          " --arena comrad-[0-9a-f]+ --worker_index 0\n"));
  EXPECT_THAT(all, testing::ContainsRegex("learner start [0-9]+ --run_dir " + run_dir_ +
                                          " --arena comrad-[0-9a-f]+ --mode train\n"));
  EXPECT_THAT(events(),
              testing::IsSupersetOf({"sim-0 threads 1 0", "policy-0 threads 1 -", "learner threads 2 -"}));
}

TEST_F(Launch, AKilledSimulatorAndPolicyWorkerAreRestartedAndTheRunContinues) {
  start("sim-0 fill 0\n");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  kill(pids("sim-0").back(), SIGKILL);
  kill(pids("policy-0").back(), SIGKILL);
  ASSERT_TRUE(test::wait_until([&] { return pids("sim-0").size() == 2 && pids("policy-0").size() == 2; }))
      << progress();
  usleep(500'000);
  kill(probe_, SIGTERM);
  ASSERT_EQ(wait_for_end(), 0) << story();
  EXPECT_EQ(outcome()["restarts"], 2);
  EXPECT_EQ(outcome()["steps_lost"], 2 * 5) << "two agents, five rows in the slab of the dead simulator";
  EXPECT_EQ(pids("learner").size(), 1u);
  EXPECT_THAT(progress(), HasSubstr("sim-0 died (killed by signal 9 (Killed)), starts again in"));
  EXPECT_THAT(progress(), HasSubstr("10 decisions lost"));
}

TEST_F(Launch, BadInputIsNotTriedTwice) {
  start("policy-0 say batch_size: -1 is not allowed\npolicy-0 exit 2\n");
  ASSERT_EQ(wait_for_end(), 1) << story();
  EXPECT_THAT(std::string(outcome()["error"]),
              HasSubstr("policy-0 cannot run: its last line: batch_size: -1 is not"));
  EXPECT_EQ(pids("policy-0").size(), 1u);
}

TEST_F(Launch, SigtermStopsAllWorkersCleanly) {
  start("");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  kill(probe_, SIGTERM);
  ASSERT_EQ(wait_for_end(), 0) << story();
  EXPECT_EQ(outcome()["interrupted"], true);
  EXPECT_THAT(events(), testing::IsSupersetOf(
                            {"sim-0 stopped", "sim-1 stopped", "policy-0 stopped", "learner stopped"}));
  EXPECT_EQ(status()["state"], "paused");
  EXPECT_EQ(status()["message"],
            "interrupted by SIGTERM; continue with --experiment " + fs::path(run_dir_).filename().string());
}

TEST_F(Launch, ALearnerThatDoesNotStopIsKilledAndTheExitCodeIsNotZero) {
  start("learner deaf 0\n");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  kill(probe_, SIGTERM);
  ASSERT_EQ(wait_for_end(), 1) << story();
  EXPECT_TRUE(has_shown("learner did not stop in time and is killed")) << story();
  EXPECT_THAT(std::string(status()["message"]), HasSubstr("did not save a last checkpoint"));
}

TEST_F(Launch, ASecondSigintStopsAtOnce) {
  start("learner deaf 0\nsim-0 deaf 0\n");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  kill(probe_, SIGINT);
  // One that comes before the first is heard would be taken for the same.
  ASSERT_TRUE(test::wait_until([&] { return has_shown("SIGINT: stopping"); })) << story();
  usleep(300'000);
  EXPECT_EQ(waitpid(probe_, nullptr, WNOHANG), 0) << "the first one waits for the learner";
  kill(probe_, SIGINT);
  EXPECT_EQ(wait_for_end(), 130) << story();
  EXPECT_FALSE(has_shown("did not stop in time")) << "it waited as long as after the first";
}

TEST_F(Launch, WorkersDieWithASupervisorThatIsKilled) {
  start("");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  EXPECT_EQ(living_workers().size(), 4u);
  kill(probe_, SIGKILL);
  EXPECT_EQ(wait_for_end(), -SIGKILL) << story();
  EXPECT_TRUE(test::wait_until([&] { return living_workers().empty(); }));
}

TEST_F(Launch, TheTerminalsCtrlCReachesOnlyTheSupervisor) {
  start("");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  for (const pid_t pid : living_workers()) kill(pid, SIGINT);
  usleep(500'000);
  EXPECT_EQ(living_workers().size(), 4u) << "a terminal sends SIGINT to the whole process group";
  kill(probe_, SIGINT);
  EXPECT_EQ(wait_for_end(), 0) << story();
  EXPECT_EQ(outcome()["restarts"], 0);
}

TEST_F(Launch, EvaluationEndsWithTheLastEpisodeAndKeepsEachOnce) {
  start("sim-0 episodes 5\nsim-1 episodes 7\n", {"policy=random", "episodes=7"});
  ASSERT_EQ(wait_for_end(), 0) << story();
  const nlohmann::json result = outcome();
  ASSERT_EQ(result["episodes"].size(), 7u);
  for (int id = 0; id < 7; ++id) {
    EXPECT_EQ(result["episodes"][id]["id"], id);
    EXPECT_EQ(result["episodes"][id]["score"], id);
    EXPECT_EQ(result["episodes"][id]["agents"], 2);
  }
  EXPECT_TRUE(pids("learner").empty());
  std::string all;
  for (const std::string& event : events()) all += event + "\n";
  EXPECT_THAT(all, testing::ContainsRegex("sim-0 start .*--evaluate\n"));
  EXPECT_THAT(all, testing::ContainsRegex("policy-0 start .*--random --evaluate\n"));
  EXPECT_EQ(status()["state"], "finished");
  EXPECT_EQ(status()["J_mean"], 3.0);
}

TEST_F(Launch, ACheckpointIsServedByALearnerThatDoesNotTrain) {
  start("sim-0 episodes 3\n", {"policy=checkpoint", "checkpoint=/some/where.pt", "episodes=3"});
  ASSERT_EQ(wait_for_end(), 0) << story();
  std::string all;
  for (const std::string& event : events()) all += event + "\n";
  EXPECT_THAT(all, testing::ContainsRegex("learner start .*--mode serve --checkpoint /some/where.pt\n"));
}

TEST_F(Launch, ABenchCountsOnlyItsWindow) {
  start("", {"seconds=2", "warmup=0.5"});
  ASSERT_EQ(wait_for_end(), 0) << story();
  const nlohmann::json result = outcome();
  const double seconds = result["measured_seconds"];
  EXPECT_GE(seconds, 1.7);
  // The fake learner trains 64 decisions in one update, at most every 50 ms.
  EXPECT_EQ(result["measured_decisions"], 64 * int(result["measured_updates"]));
  EXPECT_GT(result["measured_updates"], 0);
  EXPECT_LE(result["measured_updates"], 20 * seconds + 7);
  EXPECT_EQ(result["lag_mean"], 2.0);
  EXPECT_EQ(result["interrupted"], false);
}

TEST_F(Launch, InLockStepOneDeathSendsAllWorkersBackToTheCheckpoint) {
  start("learner restored 1000000\n", {"deterministic=1"});
  ASSERT_TRUE(test::wait_until([&] { return has_shown(" 5120 env frames/s"); })) << story();
  kill(pids("sim-1").back(), SIGKILL);
  ASSERT_TRUE(test::wait_until([&] { return pids("").size() == 8; })) << progress();
  EXPECT_TRUE(test::wait_until([&] {
    const std::vector<std::string> all = events();
    return std::count(all.begin(), all.end(), "learner running") == 2;
  }));
  kill(probe_, SIGTERM);
  EXPECT_EQ(wait_for_end(), 0) << story();
  EXPECT_THAT(std::string(outcome()["message"]), HasSubstr(": 4M env frames, "));
  EXPECT_THAT(std::string(outcome()["message"]), Not(HasSubstr("M trained on")));
  EXPECT_GT(outcome()["env_frames_lost"], 0);
  EXPECT_LT(outcome()["env_frames_lost"], 1'000'000);
}

TEST_F(Launch, ALearnerThatGoesBackReportsHowMuchLearningWasLost) {
  // Every life of the learner begins at its checkpoint of 100 000 decisions.
  start("learner restored 100000\n");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  ASSERT_TRUE(test::wait_until([&] { return status()["learner_version"] >= 4; })) << story();
  kill(pids("learner").back(), SIGKILL);
  ASSERT_TRUE(test::wait_until([&] {
    const std::vector<std::string> all = events();
    return std::count(all.begin(), all.end(), "learner running") == 2;
  })) << progress();
  ASSERT_TRUE(test::wait_until([&] { return has_shown("| learner went back "); })) << progress();
  kill(probe_, SIGTERM);
  ASSERT_EQ(wait_for_end(), 0) << story();

  const nlohmann::json result = outcome();
  const auto lost = result["env_frames_lost"].get<uint64_t>(),
             learned = status()["env_frames"].get<uint64_t>();
  EXPECT_GE(lost, 256 * 4) << "four updates and more, of 256 env frames each";
  EXPECT_EQ(lost % 256, 0u);
  EXPECT_GT(learned, 400'000u);
  EXPECT_EQ(status()["decisions"].get<uint64_t>(), learned / 4) << "the checkpoint's count, not the work's";
  const std::string both =
      ": " + count_text(learned) + " env frames, " + count_text(learned - 400'000 + lost) + " trained on in ";
  const std::string back = "learner went back " + count_text(lost) + " env frames to its last checkpoint";
  EXPECT_THAT(std::string(result["message"]), testing::AllOf(HasSubstr(both), HasSubstr("; " + back)));
  EXPECT_THAT(std::string(status()["message"]), HasSubstr("; " + back));
  EXPECT_THAT(progress(), HasSubstr(back + "\n")) << "at once, and in every line of progress";
}

TEST_F(Launch, PassesACheckpointRequestOn) {
  start("learner finish 4000\n");
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  kill(probe_, SIGUSR1);
  EXPECT_TRUE(test::wait_until([&] { return has_shown("SIGUSR1: a checkpoint"); }));
  ASSERT_EQ(wait_for_end(), 0) << "SIGUSR1 ended it";
}

TEST_F(Launch, AnArenaThatDoesNotFitIsReported) {
  start("", {"slabs=1000000"});
  ASSERT_EQ(wait_for_end(), 1) << story();
  EXPECT_THAT(std::string(outcome()["error"]),
              testing::AllOf(HasSubstr("needs"), HasSubstr("--trajectory_slabs")));
  EXPECT_EQ(status()["state"], "failed");
}

TEST_F(Launch, AMissingProgramIsNamed) {
  LaunchPlan plan;
  plan.run_dir = run_dir_;
  plan.bin_dir = run_dir_;
  plan.env.head_sizes = {3, 3, 3};
  plan.config.collection.num_workers = plan.config.collection.worker_num_splits = 1;
  plan.config.collection.policy_workers = 1;
  plan.config.collection.trajectory_slabs = 8;
  plan.show_progress = false;
  const Expected<RunOutcome> result = run(plan);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(result.error().message, HasSubstr(run_dir_ + "/comrad-sim-worker"));
}

TEST_F(Launch, TheLearnerHoldsTheLockOfTheRunDirectoryAndSimulatorsDoNot) {
  const std::string lock_path = run_dir_ + "/.lock";
  const int lock = open(lock_path.c_str(), O_RDWR | O_CREAT, 0644);  // inherited by the probe
  ASSERT_EQ(flock(lock, LOCK_EX | LOCK_NB), 0);
  start("", {"lock=" + std::to_string(lock)});
  ASSERT_TRUE(test::wait_until([&] { return all_run(); }));
  const auto holds = [&](pid_t pid) {
    for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(pid) + "/fd")) {
      std::error_code gone;
      if (fs::read_symlink(entry.path(), gone) == lock_path) return true;
    }
    return false;
  };
  EXPECT_TRUE(holds(pids("learner").back()));
  EXPECT_FALSE(holds(pids("sim-0").back()));
  close(lock);
}

}  // namespace supervisor_test
}  // namespace comrad::deploy
