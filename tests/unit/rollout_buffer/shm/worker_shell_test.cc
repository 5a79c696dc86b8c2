#include "rollout_buffer/shm/worker_shell.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/shm/arena_socket.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/small_arena.h"

namespace comrad::shm {
namespace worker_shell_test {

using ::testing::ExitedWithCode;
using ::testing::HasSubstr;
using ::testing::KilledBySignal;

/// A worker program in a separate process for every run: the shell takes signals and the log, which are the process's.
class WorkerShellTest : public ::testing::Test {
 protected:
  WorkerShellTest() { run_dir_.write("config.toml", settings_to_toml(RunConfig())); }

  /// The life of a program with these words behind its --run_dir.
  [[noreturn]] void live(const std::vector<std::string>& words, const WorkerJobs& jobs,
                         bool is_single = false) {
    WorkerShell shell(
        {.name = "comrad-test-worker", .role = "test", .description = "", .is_single = is_single});
    live(shell, words, jobs);
  }
  [[noreturn]] void live(WorkerShell& shell, std::vector<std::string> words, const WorkerJobs& jobs) {
    words.insert(words.begin(), {"comrad-test-worker", "--run_dir", run_dir_.string()});
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const int code = shell.run(static_cast<int>(words.size()), argv.data(), jobs);
    std::fflush(stdout);
    _exit(code);  // other threads may still be about
  }
  static WorkerJobs failing(ErrorCode code) {
    const auto fail = [code] { return Error{code, "what went wrong"}; };
    return {.work = [fail](const RunConfig&) { return fail(); },
            .bench = [fail](const RunConfig&, double) { return fail(); }};
  }
  std::string log(const std::string& name) const {
    std::ifstream file(run_dir_ / ("logs/" + name + ".log"));
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }

  test::ScratchFolder run_dir_;
};

TEST_F(WorkerShellTest, BadInputExitsWithTwoWhateverItsKind) {
  for (const ErrorCode code :
       {ErrorCode::kBadInput, ErrorCode::kBadFormat, ErrorCode::kNotFound, ErrorCode::kUnsupported}) {
    EXPECT_EXIT(live({"--arena", "a"}, failing(code)), ExitedWithCode(kExitBadInput), "what went wrong");
    EXPECT_EXIT(live({"--bench", "1"}, failing(code)), ExitedWithCode(kExitBadInput), "what went wrong");
  }
}

TEST_F(WorkerShellTest, WhatAnotherStartMayRepairExitsWithOne) {
  for (const ErrorCode code :
       {ErrorCode::kNoSpace, ErrorCode::kPeerLost, ErrorCode::kSystem, ErrorCode::kTimeout})
    EXPECT_EXIT(live({"--arena", "a"}, failing(code)), ExitedWithCode(kExitFailed), "what went wrong");
  const WorkerJobs throwing = {
      .work = [](const RunConfig&) -> Status { throw std::runtime_error("a library's"); }, .bench = {}};
  EXPECT_EXIT(live({"--arena", "a"}, throwing), ExitedWithCode(kExitFailed), "a library's");
  EXPECT_THAT(log("test-0"), HasSubstr("a library's"));
}

TEST_F(WorkerShellTest, WorkThatIsDoneButNotSavedHasASeparateCode) {
  EXPECT_EXIT(live({"--arena", "a"}, failing(ErrorCode::kNotSaved)), ExitedWithCode(kExitNotSaved), "");
}

TEST_F(WorkerShellTest, ACommandLineThatCannotBeReadExitsWithTwo) {
  const WorkerJobs never = {.work = [](const RunConfig&) -> Status { std::abort(); },
                            .bench = [](const RunConfig&, double) -> Status { std::abort(); }};
  EXPECT_EXIT(live({}, never), ExitedWithCode(kExitBadInput), "comrad-test-worker: give --arena NAME");
  EXPECT_EXIT(live({"--arena", "a", "--worker_index", "-1"}, never), ExitedWithCode(kExitBadInput),
              "--worker_index");
  EXPECT_EXIT(live({"--bench", "0"}, never), ExitedWithCode(kExitBadInput), "--bench");
  EXPECT_EXIT(live({"--arena", "a", "--worker_index", "1"}, never, /*is_single=*/true),
              ExitedWithCode(kExitBadInput), "--worker_index");
  run_dir_.write("config.toml", "rolout = 3\n");
  EXPECT_EXIT(live({"--arena", "a"}, never), ExitedWithCode(kExitBadInput), "rollout");
}

TEST_F(WorkerShellTest, InARunSigtermRequestsAStopAndSigintIsNotForWorkers) {
  const auto run = [this] {
    WorkerShell shell({.name = "comrad-test-worker", .role = "test", .description = ""});
    live(shell, {"--arena", "a", "--worker_index", "7"},
         {.work = [&](const RunConfig&) -> Status {
            raise(SIGINT);
            if (shell.stop()) return Error{ErrorCode::kSystem, "stopped too soon"};
            raise(SIGTERM);
            if (!shell.stop()) return Error{ErrorCode::kSystem, "did not stop"};
            spdlog::info("worker {} leaves", shell.worker_index());
            return {};
          },
          .bench = {}});
  };
  EXPECT_EXIT(run(), ExitedWithCode(kExitDone), "");
  EXPECT_THAT(log("test-7"), HasSubstr("test-7: worker 7 leaves"));
}

TEST_F(WorkerShellTest, ABenchIsEndedBySignalsAndWritesNothingIntoTheRun) {
  const WorkerJobs raising = {.work = {}, .bench = [](const RunConfig&, double) -> Status {
                                raise(SIGTERM);
                                return {};
                              }};
  EXPECT_EXIT(live({"--bench", "1"}, raising), KilledBySignal(SIGTERM), "");
  EXPECT_EQ(log("test-0"), "");
}

TEST_F(WorkerShellTest, JoinsWithItsRole) {
  const auto run = [this] {
    const Arena arena = *Arena::create(test::small_arena_shape(), 11);
    Expected<ArenaServer> server =
        ArenaServer::listen("comrad-test-" + std::to_string(getpid()) + "-shell", arena);
    if (!server) _exit(50);
    std::thread peer([&] {
      Expected<JoinRequest> request = server->serve_one();
      for (int attempt = 0; attempt < 30 && !request; ++attempt) request = server->serve_one();
      if (!request || std::string(request->role) != "test" || request->worker_index != 1) _exit(51);
    });
    WorkerShell shell({.name = "comrad-test-worker", .role = "test", .description = ""});
    live(shell, {"--arena", server->name(), "--worker_index", "1"},
         {.work = [&](const RunConfig&) -> Status {
            COMRAD_TRY_ASSIGN(const Arena joined, shell.join());
            peer.join();
            return joined.run_id() == 11 ? Status() : Error{ErrorCode::kSystem, "another arena"};
          },
          .bench = {}});
  };
  EXPECT_EXIT(run(), ExitedWithCode(kExitDone), "");
}

TEST(WordsOfFailure, NameWhatToLowerWhereAGpuIsFull) {
  EXPECT_EQ(words_of_failure("a tensor is too large\nframe #0"), "a tensor is too large\nframe #0");
  for (const char* what :
       {"CUDA out of memory. Tried to allocate 2.00 GiB (GPU 0; 79 GiB total)\nframe #0: x",
        "CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`"})
    EXPECT_THAT(words_of_failure(what),
                ::testing::AllOf(::testing::StartsWith("CUDA"), HasSubstr("lower --micro_batch_size"),
                                 ::testing::Not(HasSubstr("\n"))));
}

TEST(BenchShape, ReadsItsFlagsAndNamesWhatIsOutOfRange) {
  BenchShape shape;
  Flags flags("", "");
  shape.add_flags(flags);
  const char* words[] = {"program", "--num_agents", "3", "--heads", "3,2", "--measurements", "4"};
  ASSERT_FALSE(flags.parse(std::size(words), words));
  const Expected<EnvShape> env = shape.env();
  ASSERT_TRUE(env) << env.error().message;
  EXPECT_EQ(env->num_agents, 3);
  EXPECT_EQ(env->head_count, 2);
  EXPECT_EQ(env->head_sizes[1], 2);
  EXPECT_EQ(env->measurement_count, 4);
  shape.heads = {3, 99};
  EXPECT_EQ(shape.env().error().code, ErrorCode::kBadInput);
  shape.heads.assign(kMaxHeads + 1, 3);
  EXPECT_THAT(shape.env().error().message, HasSubstr("--heads"));
}

}  // namespace worker_shell_test
}  // namespace comrad::shm
