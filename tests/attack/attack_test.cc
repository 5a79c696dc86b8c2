// What a careless or hostile neighbour does to a run: damaged files, limits, signals, terminals that stand still.
// Nothing may be lost without a message, and no unknown peer may join.

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/ioctl.h>
#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>

#include "rollout_buffer/core/rng.h"
#include "tests/integration/running_program.h"

namespace comrad::test {
namespace attack_test {

namespace fs = std::filesystem;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kBadInput = 2, kFailed = 1;

/// The command as words of one shell line, each quoted.
std::string shell_words(const std::vector<std::string>& command) {
  std::string line;
  for (const std::string& word : command) line += "'" + word + "' ";
  return line;
}

/// Runs a line of bash in which $RUN is the command.
std::vector<std::string> in_shell(const std::string& line) { return {"/bin/bash", "-c", line}; }

Ending run(const std::vector<std::string>& command) { return RunningProgram(command).wait(); }

std::vector<std::string> checkpoints_of(const std::string& run_dir) {
  return files(run_dir + "/checkpoint", "checkpoint_", ".pt");
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

/// A short run with one checkpoint, made once; each test gets it whole.
class FinishedRun : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    made_ = std::make_unique<ScratchFolder>();
    const Ending ending = run(small_training(*made_, "run", 4096, {"--keep_checkpoints", "1"}));
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    fs::copy(*made_ / "run", *made_ / "whole", fs::copy_options::recursive);
  }
  static void TearDownTestSuite() { made_.reset(); }
  void SetUp() override {
    fs::remove_all(run_);
    fs::copy(scratch_ / "whole", run_, fs::copy_options::recursive);
    ASSERT_EQ(checkpoints_of(run_).size(), 1u);
    checkpoint_ = checkpoints_of(run_)[0];
  }

  static inline std::unique_ptr<ScratchFolder> made_;
  const ScratchFolder& scratch_ = *made_;
  const std::string run_ = scratch_ / "run";
  std::string checkpoint_;
};

TEST_F(FinishedRun, ADamagedLastCheckpointIsRefusedEveryTime) {
  fs::resize_file(checkpoint_, fs::file_size(checkpoint_) / 2);
  for (int attempt = 0; attempt < 2; ++attempt) {
    const Ending ending = run(small_training(scratch_, "run", 8192));
    EXPECT_NE(ending.exit_code, 0) << "attempt " << attempt << " trained from nothing";
    EXPECT_THAT(ending.err, HasSubstr("--restart_behavior restart"));
  }
  const Ending anew = run(small_training(scratch_, "run", 2048, {"--restart_behavior", "restart"}));
  EXPECT_EQ(anew.exit_code, 0) << anew.err;
}

TEST_F(FinishedRun, ATensorOfGarbageIsSeenByTrainingAndByEvaluation) {
  std::string bytes = read_text(checkpoint_);
  bytes.replace(bytes.size() / 2, 4096, 4096, '\xFF');  // the largest tensors lie in the middle
  write_bytes(checkpoint_, bytes);
  const Ending eval = run({program("comrad"), "eval", "--policy", run_, "--episodes", "2"});
  EXPECT_NE(eval.exit_code, 0) << "a score was reported for garbage: " << eval.out;
  EXPECT_THAT(eval.err, HasSubstr("damaged"));
  const Ending ending = run(small_training(scratch_, "run", 16384));
  EXPECT_NE(ending.exit_code, 0);
  EXPECT_THAT(ending.err, HasSubstr("damaged"));
}

TEST_F(FinishedRun, DamagedSmallFilesEndInWordsNotInCrashes) {
  const uint64_t seed = 20261124;
  Rng rng(seed);
  for (const char* name : {"config.toml", "status.json"}) {
    const std::string path = run_ + "/" + name, intact = read_text(path);
    ASSERT_FALSE(intact.empty()) << path;
    for (int round = 0; round < 2; ++round) {
      std::string damaged = intact;
      for (int flip = 0; flip < 8; ++flip) {
        const std::size_t at = rng.below(static_cast<uint32_t>(damaged.size()));
        damaged[at] = static_cast<char>(damaged[at] ^ (1 << rng.below(8)));
      }
      write_bytes(path, damaged);
      const Ending eval =
          run({program("comrad"), "eval", "--policy", run_, "--episodes", "1", "--seed", "3", "--json"});
      EXPECT_THAT(eval.exit_code, AnyOf(0, kFailed, kBadInput))
          << name << ", seed " << seed << " round " << round << ": " << eval.err;
      if (eval.exit_code != 0) {
        EXPECT_THAT(eval.err, HasSubstr("error")) << name << " round " << round;
      }
    }
    write_bytes(path, intact);
  }
}

TEST_F(FinishedRun, APipeUnderACheckpointsNameIsNoReasonToHang) {
  ASSERT_EQ(mkfifo((run_ + "/checkpoint/checkpoint_000009999_99999999.pt").c_str(), 0600), 0);
  const Ending ending = run(small_training(scratch_, "run", 8192));
  EXPECT_FALSE(ending.timed_out);
  EXPECT_EQ(ending.exit_code, 0) << ending.err;  // the checkpoint before it is whole
}

/// An endless small run that has begun to train.
class VictimRun : public ::testing::Test {
 protected:
  void begin(const std::vector<std::string>& more = {}) {
    training_ = std::make_unique<RunningProgram>(small_training(scratch_, "run", 1e9, more));
    ASSERT_TRUE(wait_until([this] { return env_frames(run_) > 0 || !training_->running(); }));
    ASSERT_TRUE(training_->running()) << training_->wait().err;
  }

  ScratchFolder scratch_;
  const std::string run_ = scratch_ / "run";
  std::unique_ptr<RunningProgram> training_;
};

TEST_F(VictimRun, ALearnerThatIsAskedToStopHasNotFinishedTheRun) {
  begin();
  const auto learner = processes_of(run_, "comrad-learner");
  ASSERT_EQ(learner.size(), 1u);
  kill(learner[0], SIGTERM);
  const Ending ending = training_->wait();
  EXPECT_THAT(ending.err, Not(HasSubstr("finished")));
  EXPECT_EQ(read_json(run_ + "/status.json")["state"], "paused");
  EXPECT_FALSE(checkpoints_of(run_).empty());
}

TEST(Attack, ATerminalThatStandsStillNeverStopsARun) {
  const ScratchFolder scratch;
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);  // never read
  ASSERT_GE(fcntl(ends[1], F_SETPIPE_SZ, 4096), 0);
  fcntl(ends[0], F_SETFD, FD_CLOEXEC);
  RunningProgram training(
      in_shell("exec " + shell_words(small_training(scratch, "run", 1e9, {"--progress_interval", "0.1"})) +
               "2>&" + std::to_string(ends[1])));
  close(ends[1]);
  const std::string run_dir = scratch / "run";
  ASSERT_TRUE(wait_until([&] { return env_frames(run_dir) > 0; }));
  // Of its one page less than a few lines are free: soon one does not fit.
  ASSERT_TRUE(wait_until([&] {
    int waiting = 0;
    return ioctl(ends[0], FIONREAD, &waiting) == 0 && waiting > 4096 - 512;
  }));
  const double before = env_frames(run_dir);
  EXPECT_TRUE(wait_until([&] { return env_frames(run_dir) > before; })) << "status.json stands still";
  training.signal(SIGTERM);
  const Ending ending = training.wait();
  EXPECT_FALSE(ending.timed_out) << "SIGTERM was ignored";
  EXPECT_EQ(ending.exit_code, 0);
  close(ends[0]);
}

TEST(Attack, ALastCheckpointThatCannotBeWrittenEndsTheRunOnceAndReportsWhatIsLost) {
  const ScratchFolder scratch;
  const std::string run_dir = scratch / "run";
  RunningProgram training(small_training(scratch, "run", 1e9, {"--train_for_seconds", "10"}));
  ASSERT_TRUE(wait_until([&] { return env_frames(run_dir) > 0 || !training.running(); }));
  fs::rename(run_dir + "/checkpoint", run_dir + "/gone");
  write_bytes(run_dir + "/checkpoint", "no folder");
  const Ending ending = training.wait();
  EXPECT_FALSE(ending.timed_out);
  EXPECT_EQ(ending.exit_code, kFailed) << ending.err;
  EXPECT_THAT(ending.err, HasSubstr("the last checkpoint could not be written"));
  EXPECT_THAT(ending.err, HasSubstr("env frames since the run's beginning are lost"));
  EXPECT_THAT(ending.err, Not(HasSubstr("starts again"))) << "the same frames were trained on again";
  EXPECT_EQ(read_json(run_dir + "/status.json")["state"], "failed");
}

TEST(Attack, ALimitOfFileSizeIsNamed) {
  const ScratchFolder scratch;
  for (const char* kilobytes : {"4", "512"}) {  // too little for the map, and for shared memory
    const Ending ending = run(in_shell(std::string("ulimit -f ") + kilobytes + "; exec " +
                                       shell_words(small_training(scratch, "run", 16384))));
    EXPECT_THAT(ending.exit_code, AnyOf(kFailed, kBadInput)) << ending.err;
    EXPECT_THAT(ending.err, HasSubstr("ulimit -f"));
  }
}

TEST(Attack, AReaderThatLeavesOrClosedDescriptorsDoNotMatter) {
  const ScratchFolder scratch;
  const Ending piped = run(in_shell(shell_words(small_training(scratch, "piped", 1024)) +
                                    "2>&1 | head -1; exit ${PIPESTATUS[0]}"));
  EXPECT_EQ(piped.exit_code, 0) << piped.out;
  EXPECT_EQ(read_json(scratch / "piped/status.json")["state"], "finished");
  const Ending closed =
      run(in_shell("exec " + shell_words(small_training(scratch, "closed", 1024)) + "<&- >&-"));
  EXPECT_EQ(closed.exit_code, 0) << closed.err;
  const Ending all_closed =
      run(in_shell("exec " + shell_words(small_training(scratch, "all", 1024)) + "<&- >&- 2>&-"));
  EXPECT_EQ(all_closed.exit_code, 0);
  EXPECT_EQ(read_json(scratch / "all/status.json")["state"], "finished");
}

TEST(Attack, AbsurdInputIsRefusedBeforeAnythingIsMade) {
  const ScratchFolder scratch;
  std::string deep = "a";
  for (int i = 0; i < 100'000; ++i) deep += ".a";
  scratch.write("deep.toml", deep + " = 1\n");
  scratch.write("scenario/scenario.toml", deep + " = 1\n");
  const std::vector<std::vector<std::string>> absurd = {
      {"--config", scratch / "deep.toml"},  {"--config", "/dev/zero"},
      {"--scenario", scratch / "scenario"}, {"--learning_rate", "1e300"},
      {"--layout_pool", "train:0"},         {"--reward_scale", "-1e200"},
      {"--experiment", "caf\xE9"},          {"--train_for_env_frames", "1e300"},
  };
  fs::create_directories(scratch / "runs");
  for (const auto& flags : absurd) {
    std::vector<std::string> command = small_training(scratch, "run", 8192, flags);
    *std::find(command.begin(), command.end(), scratch.string()) = (scratch / "runs").string();
    const Ending ending = run(command);
    EXPECT_FALSE(ending.timed_out) << flags[0] << " " << flags[1];
    EXPECT_EQ(ending.exit_code, kBadInput) << flags[0] << " " << flags[1] << ": " << ending.err;
    EXPECT_THAT(ending.err, HasSubstr("error")) << flags[0];
    EXPECT_TRUE(fs::is_empty(scratch / "runs")) << flags[0] << " " << flags[1] << " left a folder";
  }
}

}  // namespace attack_test
}  // namespace comrad::test
