// Workers that are killed and runs that are interrupted, with the real programs: training continues or ends cleanly, and nothing
// is left behind. In how many ways that may come is played without processes (tests/simulation).

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace supervision_test {

using ::testing::SizeIs;

/// Waits until the learner has trained on `frames` more than now.
bool trains_on(const std::string& run, double frames) {
  const double before = env_frames(run);
  return wait_until([&] { return env_frames(run) >= before + frames; });
}

/// An endless small run that has begun to train. `link` selects how simulators reach the policy.
class EndlessRun : public ::testing::Test {
 protected:
  explicit EndlessRun(const std::vector<std::string>& settings = {})
      : run_(scratch_ / "run"), training_(small_training(scratch_, "run", 1e9, with_checkpoints(settings))) {}

  void SetUp() override {
    ASSERT_TRUE(wait_until([this] { return env_frames(run_) > 0 || !training_.running(); }));
    ASSERT_TRUE(training_.running()) << training_.wait(1).err;
  }

  /// A new learner continues from a checkpoint that is a second old, not from the beginning.
  static std::vector<std::string> with_checkpoints(std::vector<std::string> settings) {
    settings.insert(settings.end(), {"--save_every_sec", "1"});
    return settings;
  }

  /// Kills one worker outright and expects training to continue with a new one in its place.
  void kill_and_expect_a_successor(const std::string& worker, size_t count) {
    const auto before = processes_of(run_, worker);
    ASSERT_THAT(before, SizeIs(count));
    ASSERT_EQ(kill(before[0], SIGKILL), 0);
    EXPECT_TRUE(wait_until([&] {
      const auto now = processes_of(run_, worker);
      return now.size() == count && std::find(now.begin(), now.end(), before[0]) == now.end();
    })) << worker
        << " was not restarted";
    EXPECT_TRUE(trains_on(run_, 4096)) << "training did not continue after " << worker << " was killed";
    EXPECT_TRUE(training_.running());
  }

  /// Sends `number` and expects a clean end, a checkpoint, and no process left.
  void expect_clean_stop(int number) {
    training_.signal(number);
    const Ending ending = training_.wait();
    EXPECT_FALSE(ending.timed_out) << ending.err;
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_FALSE(files(run_ + "/checkpoint", "checkpoint_", ".pt").empty());
    EXPECT_TRUE(files(run_ + "/checkpoint", ".tmp-").empty()) << "half-written files";
    EXPECT_TRUE(processes_of(run_).empty());
    const nlohmann::json status = read_json(run_ + "/status.json");
    EXPECT_NE(status["state"], "running");
  }

  ScratchFolder scratch_;
  std::string run_;
  RunningProgram training_;
};

TEST_F(EndlessRun, AnInterruptEndsItCleanlyAndItResumes) {
  ASSERT_TRUE(trains_on(run_, 4096));
  expect_clean_stop(SIGINT);
  const double before = env_frames(run_);
  RunningProgram resumed(small_training(scratch_, "run", before + 4096));
  EXPECT_EQ(resumed.wait().exit_code, 0);
  EXPECT_GE(env_frames(run_), before + 4096);
}

/// `nohup ./comrad train &`, and logging out.
TEST(IgnoredSignals, StayIgnored) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  std::vector<std::string> command = {"/usr/bin/env", "--ignore-signal=HUP"};
  for (const std::string& word : small_training(scratch, "run", 1e9)) command.push_back(word);
  RunningProgram training(command);
  ASSERT_TRUE(wait_until([&] { return env_frames(run) > 0 || !training.running(); }));
  training.signal(SIGHUP);
  EXPECT_TRUE(trains_on(run, 8192));
  EXPECT_TRUE(training.running());
  training.signal(SIGTERM);
  const Ending ending = training.wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.err, ::testing::Not(::testing::HasSubstr("SIGHUP")));
}

TEST_F(EndlessRun, NothingIsLeftWhenTheSupervisorIsKilled) {
  training_.signal(SIGKILL);
  training_.wait();
  EXPECT_TRUE(wait_until([this] { return processes_of(run_).empty(); }))
      << processes_of(run_).size() << " processes are left";
}

/// Shared memory's workers are killed by chaos_test.
class LinkedRun : public EndlessRun {
 protected:
  LinkedRun() : EndlessRun({"--link", "dds"}) {}
};

/// The learner has two policy workers as threads.
class ThreadedRun : public EndlessRun {
 protected:
  ThreadedRun() : EndlessRun({"--policy_processes", "False", "--policy_workers", "2"}) {}
};

TEST_F(ThreadedRun, ContinuesAfterSimulatorAndLearnerWereKilled) {
  EXPECT_THAT(processes_of(run_, "comrad-policy-worker"), SizeIs(0));
  kill_and_expect_a_successor("comrad-sim-worker", 2);
  kill_and_expect_a_successor("comrad-learner", 1);
  expect_clean_stop(SIGTERM);
}

TEST_F(LinkedRun, ContinuesAfterSimulatorPolicyWorkerAndLearnerWereKilled) {
  kill_and_expect_a_successor("comrad-sim-worker", 2);
  kill_and_expect_a_successor("comrad-policy-worker", 1);
  kill_and_expect_a_successor("comrad-learner", 1);
  expect_clean_stop(SIGTERM);
}

}  // namespace supervision_test
}  // namespace comrad::test
