#include "deploy/launch/run_directory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <thread>

#include "rollout_buffer/settings/layers.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace run_directory_test {

namespace fs = std::filesystem;
using testing::HasSubstr;

class RunDirectoryTest : public testing::Test {
 protected:
  /// A run that wrote its config and one checkpoint, and ended.
  void leave_a_run(const std::string& experiment) {
    auto run = RunDirectory::open(train_dir_, experiment, RestartBehavior::kResume);
    ASSERT_TRUE(run) << run.error().message;
    ASSERT_TRUE(run->write_config(RunConfig{}));
    std::ofstream(run->path() + "/checkpoint/one.pt") << "weights";
  }
  bool exists(const std::string& path) const { return fs::exists(train_dir_ + "/" + path); }

  const test::ScratchFolder folder_;
  const std::string train_dir_ = folder_.string();
};

TEST_F(RunDirectoryTest, ResumeOfAFreshNameJustStarts) {
  auto run = RunDirectory::open(train_dir_, "first", RestartBehavior::kResume);
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_FALSE(run->is_resumed());
  EXPECT_EQ(run->path(), train_dir_ + "/first");
  EXPECT_TRUE(exists("first/logs"));
  EXPECT_TRUE(exists("first/checkpoint"));
}

TEST_F(RunDirectoryTest, StartsAtTheSameTimeGetSeparateFolders) {
  constexpr int kStarts = 8;
  int go[2], done[2];
  ASSERT_EQ(pipe(go), 0);
  ASSERT_EQ(pipe(done), 0);
  std::vector<pid_t> starts;
  for (int i = 0; i < kStarts; ++i) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      char word;
      close(go[1]);
      (void)!read(go[0], &word, 1);  // ends when the parent closes its side: all go at once
      const auto run = RunDirectory::open_new(train_dir_, "run");
      const bool is_mine = run && !run->is_resumed() && run->write_config(RunConfig{});
      (void)!write(done[1], is_mine ? "y" : "n", 1);
      _exit(0);
    }
    starts.push_back(child);
  }
  close(go[0]);
  close(go[1]);
  std::string words(kStarts, '?');
  for (char& word : words) ASSERT_EQ(read(done[0], &word, 1), 1);
  for (const pid_t child : starts) waitpid(child, nullptr, 0);
  close(done[0]), close(done[1]);
  EXPECT_EQ(words, std::string(kStarts, 'y'));
  EXPECT_TRUE(exists("run/config.toml"));
  for (int i = 2; i <= kStarts; ++i) EXPECT_TRUE(exists("run_" + std::to_string(i) + "/config.toml")) << i;
  EXPECT_FALSE(exists("run_" + std::to_string(kStarts + 1)));
}

TEST_F(RunDirectoryTest, ResumeKeepsWhatIsThere) {
  leave_a_run("run");
  auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kResume);
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_TRUE(run->is_resumed());
  EXPECT_TRUE(exists("run/checkpoint/one.pt"));
}

TEST_F(RunDirectoryTest, RestartRenamesTheOldRunToTheNextFreeNumber) {
  for (int life = 0; life < 2; ++life) {
    leave_a_run("run");
    auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kRestart);
    ASSERT_TRUE(run) << run.error().message;
    EXPECT_FALSE(run->is_resumed());
    EXPECT_FALSE(exists("run/checkpoint/one.pt"));
  }
  EXPECT_TRUE(exists("run_old0001/checkpoint/one.pt"));
  EXPECT_TRUE(exists("run_old0002/checkpoint/one.pt"));
}

TEST_F(RunDirectoryTest, OverwriteEmptiesARun) {
  leave_a_run("run");
  auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kOverwrite);
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_FALSE(run->is_resumed());
  EXPECT_FALSE(exists("run/checkpoint/one.pt"));
  EXPECT_FALSE(exists("run/config.toml"));
  EXPECT_FALSE(exists("run_old0001"));
}

TEST_F(RunDirectoryTest, OverwriteNeverEmptiesAFolderThatIsNoRun) {
  fs::create_directories(train_dir_ + "/thesis");
  std::ofstream(train_dir_ + "/thesis/chapter1.tex") << "important";
  auto run = RunDirectory::open(train_dir_, "thesis", RestartBehavior::kOverwrite);
  ASSERT_FALSE(run);
  EXPECT_EQ(run.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(run.error().message, HasSubstr("no config.toml"));
  EXPECT_TRUE(exists("thesis/chapter1.tex"));
}

TEST_F(RunDirectoryTest, ASecondLiveRunIsRefusedWithThePidOfTheFirst) {
  for (const RestartBehavior behavior :
       {RestartBehavior::kResume, RestartBehavior::kRestart, RestartBehavior::kOverwrite}) {
    leave_a_run("run");
    auto first = RunDirectory::open(train_dir_, "run", RestartBehavior::kResume);
    ASSERT_TRUE(first);
    auto second = RunDirectory::open(train_dir_, "run", behavior);
    ASSERT_FALSE(second) << word_of(behavior);
    EXPECT_EQ(second.error().code, ErrorCode::kBadInput);
    EXPECT_THAT(second.error().message, HasSubstr("live run (pid " + std::to_string(getpid()) + ")"));
    EXPECT_TRUE(exists("run/checkpoint/one.pt")) << word_of(behavior) << " must not touch a live run";
    EXPECT_FALSE(exists("run_old0001"));
  }
}

TEST_F(RunDirectoryTest, TheLockEndsWithItsOwner) {
  leave_a_run("run");
  int ready[2];
  ASSERT_EQ(pipe(ready), 0);
  const pid_t owner = fork();
  if (owner == 0) {
    auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kResume);
    [[maybe_unused]] const ssize_t told = write(ready[1], run ? "y" : "n", 1);
    pause();
    _exit(0);
  }
  char answer = 0;
  ASSERT_EQ(read(ready[0], &answer, 1), 1);
  EXPECT_EQ(answer, 'y');
  EXPECT_FALSE(RunDirectory::open(train_dir_, "run", RestartBehavior::kResume));
  kill(owner, SIGKILL);
  waitpid(owner, nullptr, 0);
  EXPECT_TRUE(RunDirectory::open(train_dir_, "run", RestartBehavior::kResume));
}

TEST_F(RunDirectoryTest, ALearnerThatOutlivesItsSupervisorIsWaitedFor) {
  leave_a_run("run");
  // The supervisor takes the lock and dies; its child inherited it and lives until the pipe is closed.
  int lifeline[2];
  ASSERT_EQ(pipe(lifeline), 0);
  const pid_t supervisor = fork();
  if (supervisor == 0) {
    auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kResume);
    if (fork() == 0) {
      close(lifeline[1]);
      char end;
      _exit(read(lifeline[0], &end, 1) == 0 ? 0 : 1);
    }
    _exit(run ? 0 : 1);  // no destructor: the lock stays with the child
  }
  int status = 0;
  waitpid(supervisor, &status, 0);
  ASSERT_EQ(WEXITSTATUS(status), 0);
  std::atomic<bool> is_released = false;
  std::jthread release([&] {
    usleep(200'000);  // so that the request arrives while the run is held
    is_released = true;
    close(lifeline[1]);
  });
  auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kResume);
  EXPECT_TRUE(run) << run.error().message;
  EXPECT_TRUE(is_released) << "it was opened while the learner lived";
  close(lifeline[0]);
}

TEST_F(RunDirectoryTest, NamesThatLeadElsewhereAreRefused) {
  for (const std::string& name : {std::string(""), std::string(".."), std::string("a/b"), std::string("/etc"),
                                  std::string(".hidden"), std::string("a\nb"), std::string(201, 'x')}) {
    auto run = RunDirectory::open(train_dir_, name, RestartBehavior::kResume);
    ASSERT_FALSE(run) << name;
    EXPECT_EQ(run.error().code, ErrorCode::kBadInput);
  }
}

TEST_F(RunDirectoryTest, AFolderThatCannotBeMadeIsNamed) {
  std::ofstream(train_dir_ + "/file") << "no folder";
  auto run = RunDirectory::open(train_dir_ + "/file", "run", RestartBehavior::kResume);
  ASSERT_FALSE(run);
  EXPECT_THAT(run.error().message, HasSubstr(train_dir_ + "/file/run"));
}

TEST_F(RunDirectoryTest, ConfigSurvivesTheRoundTrip) {
  auto run = RunDirectory::open(train_dir_, "run", RestartBehavior::kResume);
  ASSERT_TRUE(run);
  RunConfig config;
  config.run.seed = 7;
  config.network.rnn_type = RnnType::kLstm;
  ASSERT_TRUE(run->write_config(config));
  auto read = load_run_config(run->path() + "/config.toml");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->run.seed, 7);
  EXPECT_EQ(read->network.rnn_type, RnnType::kLstm);
}

TEST_F(RunDirectoryTest, StatusIsOneJsonObjectAndUnknownScoresAreNull) {
  RunStatus status;
  status.state = "running";
  status.env_frames = 1ull << 40;
  status.decisions = 5;
  status.learner_version = 6;
  status.env_frames_per_s = std::numeric_limits<double>::infinity();
  status.message = "a \"quoted\" line \xff";
  status.elapsed_s = 8;
  status.cpu_s = {{"simulators", 6.5}, {"learner", 2}};
  ASSERT_TRUE(write_status(train_dir_, status));
  std::ifstream file(train_dir_ + "/status.json");
  nlohmann::json json = nlohmann::json::parse(file);
  EXPECT_EQ(json["state"], "running");
  EXPECT_EQ(json["env_frames"], 1ull << 40);
  EXPECT_EQ(json["decisions"], 5);
  EXPECT_EQ(json["learner_version"], 6);
  EXPECT_TRUE(json["J_mean"].is_null());
  EXPECT_EQ(json["env_frames_per_s"], 0.0);
  EXPECT_EQ(json["elapsed_s"], 8);
  EXPECT_EQ(json["cpu_s"], (nlohmann::json{{"simulators", 6.5}, {"learner", 2}}));
  EXPECT_FALSE(exists("status.json.tmp"));
  status.score_mean = 612.5;
  ASSERT_TRUE(write_status(train_dir_, status));
  EXPECT_EQ(nlohmann::json::parse(std::ifstream(train_dir_ + "/status.json"))["J_mean"], 612.5);
}

}  // namespace run_directory_test
}  // namespace comrad::deploy
