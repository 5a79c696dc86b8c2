#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

namespace comrad::shm {
namespace bench_transport_test {

using nlohmann::json;
using ::testing::HasSubstr;

struct Outcome {
  int exit_code = -1;
  std::string output;
};

Outcome run(const std::string& flags) {
  Outcome result;
  FILE* pipe = popen(("exec " COMRAD_BENCH_TRANSPORT " " + flags).c_str(), "r");
  if (pipe == nullptr) return result;
  std::array<char, 4096> piece{};
  while (const std::size_t count = fread(piece.data(), 1, piece.size(), pipe))
    result.output.append(piece.data(), count);
  const int status = pclose(pipe);
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return result;
}

TEST(BenchTransport, HandsOverBetweenProcessesInEveryShape) {
  for (const std::string shape :
       {"", "--num_workers 1 --num_envs_per_worker 1 --rollout 1",
        "--num_workers 3 --num_envs_per_worker 5 --policy_workers 2 --num_agents 8 --rollout 4",
        "--worker_num_splits 1"}) {
    const Outcome result = run("--json --seconds 0.3 " + shape);
    ASSERT_EQ(result.exit_code, 0) << shape;
    const json report = json::parse(result.output);
    for (const char* key : {"bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s",
                            "env_frames_per_s", "windows", "spread"})
      EXPECT_TRUE(report.contains(key)) << key;
    EXPECT_EQ(report["bench"], "transport");
    const double handovers_per_s = report["handovers_per_s"];
    EXPECT_GT(handovers_per_s, 0) << shape;
    EXPECT_EQ(report["decisions_per_s"], handovers_per_s * report["num_agents"].get<double>());
    const json& latency = report["round_trip_us"];
    EXPECT_GT(latency["p50"], 0);
    EXPECT_LT(latency["p50"], 1e6);
    EXPECT_LE(latency["p50"], latency["p90"]);
    EXPECT_LE(latency["p90"], latency["p99"]);
    EXPECT_LE(latency["p99"], latency["p99_9"]);
    EXPECT_LE(latency["p99_9"], latency["max"]);
  }
}

TEST(BenchTransport, PrintsLatenciesForPeople) {
  const Outcome result = run("--seconds 0.1");
  ASSERT_EQ(result.exit_code, 0);
  EXPECT_THAT(result.output, HasSubstr("hand-overs/s"));
  EXPECT_THAT(result.output, HasSubstr("p99_9"));
}

TEST(BenchTransport, RefusesWhatCannotBeAndNamesIt) {
  for (const std::string flags : {"--seconds 0", "--num_workers 0", "--num_agents 9", "--worker_num_splits 3",
                                  "--policy_workers 9", "--no_such_flag"}) {
    const Outcome result = run(flags + " 2>&1");
    EXPECT_EQ(result.exit_code, 2) << flags;
    EXPECT_THAT(result.output, HasSubstr(flags.substr(0, flags.find(' '))));
  }
}

}  // namespace bench_transport_test
}  // namespace comrad::shm
