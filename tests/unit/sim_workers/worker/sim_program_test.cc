// comrad-sim-worker as its own process: real map, real pixels, joined over the run's socket.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "scenarios/spec/scenario_spec.h"
#include "tests/support/fake_policy.h"
#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad {
namespace sim_program_test {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr const char* kScenario = "coop_health_gathering";

std::string read_text(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// A run folder with a generated map, removed afterwards.
class SimProgram : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const std::string command = std::string(COMRAD_DOOMGEN) + " " + kScenario +
                                " --seed 42 --num_agents 2 -o " + (suite_dir() / "map.wad").string() +
                                " > /dev/null";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }

  void SetUp() override {
    run_dir_ = suite_dir() / ::testing::UnitTest::GetInstance()->current_test_info()->name();
    fs::create_directories(run_dir_);
    write_config("wad = \"" + (suite_dir() / "map.wad").string() +
                 "\"\nnum_agents = 2\nnum_envs_per_worker = 4\nworker_num_splits = 2\n");
  }
  void TearDown() override {
    for (const pid_t child : children_) {
      kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    }
  }

  void write_config(const std::string& text) const { std::ofstream(run_dir_ / "config.toml") << text; }

  pid_t start(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {COMRAD_SIM_WORKER, "--run_dir", run_dir_.string()});
    std::vector<char*> words;
    for (std::string& argument : arguments) words.push_back(argument.data());
    words.push_back(nullptr);
    const std::string out = (run_dir_ / "stdout").string(), err = (run_dir_ / "stderr").string();
    const pid_t child = fork();
    if (child == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      dup2(open(out.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600), 1);
      dup2(open(err.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600), 2);
      execv(words[0], words.data());
      _exit(127);
    }
    children_.push_back(child);
    return child;
  }

  /// Exit code, or -signal; the test fails if the process lives on.
  int wait_for(pid_t child) {
    int status = 0;
    if (!test::wait_until([&] { return waitpid(child, &status, WNOHANG) != 0; })) {
      ADD_FAILURE() << "the process does not leave";
      return -1000;
    }
    children_.erase(std::find(children_.begin(), children_.end(), child));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

  std::string errors() const { return read_text(run_dir_ / "stderr"); }

  static shm::ArenaShape arena_shape() {
    shm::ArenaShape shape;
    shape.trajectory.env = scenarios::load_scenario(kScenario)->shape(2, false);
    shape.trajectory.rollout_steps = 8;
    shape.trajectory.recurrent_state_count = 4;
    shape.envs_per_worker = 4;
    shape.slab_count = 12;
    return shape;
  }

  static const test::ScratchFolder& suite_dir() {
    static const test::ScratchFolder folder;
    return folder;
  }
  fs::path run_dir_;
  std::vector<pid_t> children_;
};

/// Drains and releases until `count` slabs came. Every one must hold a picture in every row.
void drain(const shm::Arena& arena, int count, std::vector<uint64_t>* rollouts) {
  const double deadline_s = test::deadline_s();
  while (count > 0) {
    ASSERT_LT(monotonic_s(), deadline_s) << "no more slabs";
    const uint32_t heard = shm::listen(arena.control().slab_sealed);
    for (const uint32_t index : arena.slabs().drain(100)) {
      const shm::SlabHeader& header = arena.slabs().header(static_cast<int>(index));
      const SlabView slab = arena.slabs().view(static_cast<int>(index));
      for (int step = 0; step <= static_cast<int>(header.length); ++step) {
        for (int agent = 0; agent < 2; ++agent) {
          const auto frame = slab.frame(step, agent);
          EXPECT_GT(std::count_if(frame.begin(), frame.end(), [&](uint8_t byte) { return byte != frame[0]; }),
                    1000);
          EXPECT_EQ(slab.agent_active(step, agent), 1);
        }
      }
      (*rollouts)[header.env_index] = std::max((*rollouts)[header.env_index], header.rollout_index);
      arena.slabs().release(index);
      --count;
    }
    if (count > 0) shm::wait(arena.control().slab_sealed, heard, 50'000);
  }
}

TEST_F(SimProgram, JoinsPlaysSurvivesAKillAndLeavesOnSigterm) {
  const shm::Arena arena = *shm::Arena::create(arena_shape(), 1);
  Expected<shm::ArenaServer> server = shm::ArenaServer::listen(run_dir_.string().substr(1), arena);
  ASSERT_TRUE(server) << server.error().message;
  test::FakePolicy policy(arena, 0, /*lock_step=*/false);
  arena.control().run_state = shm::RunState::kRunning;
  arena.control().rollouts_allowed = UINT64_MAX;
  std::vector<uint64_t> rollouts(4, 0);
  const auto join = [&] {
    const pid_t child = start({"--arena", server->name(), "--worker_index", "0"});
    Expected<shm::JoinRequest> request = server->serve_one();
    for (int attempt = 0; attempt < 30 && !request; ++attempt) request = server->serve_one();
    EXPECT_TRUE(request) << request.error().message << errors();
    EXPECT_STREQ(request->role, "sim");
    return child;
  };
  pid_t child = join();
  drain(arena, 20, &rollouts);
  EXPECT_EQ(arena.sim_counters(0).pid.load(), static_cast<uint32_t>(child));
  EXPECT_EQ(arena.sim_counters(0).state.load(), shm::WorkerState::kRunning);

  kill(child, SIGKILL);
  EXPECT_EQ(wait_for(child), -SIGKILL);
  (void)arena.reclaim_sim_worker(0);
  const std::vector<uint64_t> before = rollouts;
  child = join();
  drain(arena, 20, &rollouts);
  for (std::size_t env = 0; env < 4; ++env)
    EXPECT_GT(rollouts[env], before[env]) << "environment " << env << " continues";

  kill(child, SIGINT);  // Ctrl-C is the supervisor's to answer
  drain(arena, 8, &rollouts);
  kill(child, SIGTERM);
  EXPECT_EQ(wait_for(child), 0) << errors();
  EXPECT_EQ(arena.sim_counters(0).state.load(), shm::WorkerState::kStopped);
  EXPECT_EQ(policy.faults(), 0);
  EXPECT_THAT(read_text(run_dir_ / "logs" / "sim-0.log"), HasSubstr("stopped"));
}

TEST_F(SimProgram, EvaluationDeliversTheSameEpisodesEveryTime) {
  const auto play = [this] {
    shm::ArenaShape shape = arena_shape();
    shape.trajectory.rollout_steps = 32;
    const shm::Arena arena = *shm::Arena::create(shape, 1);
    Expected<shm::ArenaServer> server = shm::ArenaServer::listen(run_dir_.string().substr(1), arena);
    EXPECT_TRUE(server);
    test::FakePolicy policy(arena, 0, /*lock_step=*/false);
    arena.control().episodes_per_run = 3;
    arena.control().run_state = shm::RunState::kRunning;
    const pid_t child = start({"--arena", server->name(), "--worker_index", "0", "--evaluate"});
    EXPECT_TRUE(test::wait_until([&] { return server->serve_one().has_value(); }));
    std::vector<std::pair<uint64_t, float>> scores;
    EXPECT_TRUE(test::wait_until([&] {
      while (const std::optional<EpisodeRecord> record =
                 arena.episodes().read(shm::EpisodeReader::kSupervisor)) {
        scores.emplace_back(record->episode_id, record->score);
        EXPECT_GT(record->length_steps, 0u);
        EXPECT_GE(4 * record->length_steps, record->length_tics);
      }
      return scores.size() >= 3;
    }));
    arena.control().run_state = shm::RunState::kStopping;
    shm::ring(arena.control().run_state_changed);
    EXPECT_EQ(wait_for(child), 0) << errors();
    std::sort(scores.begin(), scores.end());
    return scores;
  };
  const auto first = play();
  ASSERT_EQ(first.size(), 3u);
  EXPECT_EQ(first, play());
}

TEST_F(SimProgram, BenchPrintsOneJsonObjectAndNothingElse) {
  const pid_t child = start({"--bench", "0.3"});
  EXPECT_EQ(wait_for(child), 0) << errors();
  const nlohmann::json report = nlohmann::json::parse(read_text(run_dir_ / "stdout"), nullptr, false);
  ASSERT_FALSE(report.is_discarded()) << read_text(run_dir_ / "stdout");
  EXPECT_GT(report.at("decisions_per_s").get<double>(), 0);
  EXPECT_DOUBLE_EQ(report.at("env_frames_per_s").get<double>(),
                   4 * report.at("decisions_per_s").get<double>());
  EXPECT_EQ(report.at("num_agents"), 2);
  EXPECT_EQ(report.at("num_envs"), 4);
  EXPECT_GE(report.at("seconds").get<double>(), 0.3);
}

TEST_F(SimProgram, BadInputHasOneClearLineAndExitCodeTwo) {
  const auto expect = [this](std::vector<std::string> arguments, const char* words) {
    EXPECT_EQ(wait_for(start(std::move(arguments))), 2) << words;
    EXPECT_THAT(errors(), HasSubstr(words));
  };
  expect({}, "give --arena NAME");
  expect({"--bench", "zero"}, "--bench");
  expect({"--worker_index", "-1", "--arena", "x"}, "--worker_index");
  expect({"--frobnicate"}, "frobnicate");
  write_config("num_agents = 2\n");
  expect({"--bench", "1"}, "wad is empty");
  const std::string no_map = "num_agents = 2\nwad = \"/nonexistent.wad\"\n";
  write_config(no_map);
  expect({"--bench", "1"}, "worker_num_splits is 0");
  write_config(no_map + "worker_num_splits = 1\n");
  expect({"--bench", "1"}, "/nonexistent.wad");
  write_config("num_agentz = 2\n");
  expect({"--bench", "1"}, "did you mean 'num_agents'");
  fs::remove(run_dir_ / "config.toml");
  expect({"--bench", "1"}, "config.toml: No such file or directory; give the path");
}

TEST_F(SimProgram, ATruncatedMapIsRefused) {
  const std::string map = read_text(suite_dir() / "map.wad");
  std::ofstream(run_dir_ / "short.wad", std::ios::binary) << map.substr(0, map.size() / 2);
  write_config("num_agents = 2\nworker_num_splits = 2\nwad = \"" + (run_dir_ / "short.wad").string() +
               "\"\n");
  EXPECT_EQ(wait_for(start({"--bench", "1"})), 2);
  EXPECT_THAT(errors(), HasSubstr("short.wad"));
}

}  // namespace sim_program_test
}  // namespace comrad
