#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/unit/rollout_buffer/replay/bench_replay_run.h"
#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace bench_replay_test {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr const char* kSmall = "--replay_gb 0.02 --seconds 0.05 --batch 2 ";

TEST(BenchReplay, PrintsOneObjectWithTheKeysOfEveryBenchAndItsOwn) {
  const test::ScratchFolder folder;
  const BenchRun run = run_bench(std::string(kSmall) + "--json --replay_file " + (folder / "ring").string());
  ASSERT_EQ(run.exit_code, 0);
  EXPECT_EQ(std::count(run.output.begin(), run.output.end(), '\n'), 1);
  const json report = json::parse(run.output);
  for (const char* key : {"bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s",
                          "env_frames_per_s", "frames_per_s", "gb_per_s"})
    EXPECT_TRUE(report.contains(key)) << key;
  EXPECT_EQ(report["bench"], "replay");
  EXPECT_EQ(report["env_frames_per_s"].get<double>(), 4 * report["decisions_per_s"].get<double>());
  EXPECT_GT(report["frames_per_s"].get<double>(), 0);
  EXPECT_GE(report["windows"].size(), 1u);
  EXPECT_GE(report["spread"], 0);
  ASSERT_EQ(report["modes"].size(), 3u);
  for (const auto& [mode, rates] : report["modes"].items()) {
    EXPECT_GE(rates["capacity_transitions"].get<int64_t>(), 640) << mode;
    EXPECT_GT(rates["insert_decisions_per_s"].get<double>(), 0) << mode;
    for (const char* unit : {"sequences_read", "joint_steps_read", "agent_steps_read"}) {
      EXPECT_GT(rates[unit]["frames_per_s"].get<double>(), 0) << mode;
      EXPECT_NEAR(rates[unit]["gb_per_s"].get<double>(), rates[unit]["frames_per_s"].get<double>() * 27648e-9,
                  1e-9);
    }
    EXPECT_EQ(rates.contains("compression_ratio"), mode == "lz4");
    EXPECT_EQ(rates.contains("sequential_gb_per_s"), mode == "mapped");
  }
  EXPECT_GT(report["modes"]["lz4"]["compression_ratio"].get<double>(), 1.2);
  EXPECT_FALSE(std::filesystem::exists(folder / "ring"));
}

TEST(BenchReplay, PrintsATableForPeople) {
  const BenchRun run = run_bench(kSmall);
  ASSERT_EQ(run.exit_code, 0);
  EXPECT_THAT(run.output, HasSubstr("frames/s"));
  EXPECT_THAT(run.output, HasSubstr("ram "));
  EXPECT_THAT(run.output, HasSubstr("LZ4 stores"));
}

TEST(BenchReplay, PicturesOfAFileAreUsed) {
  const test::ScratchFolder folder;
  std::ofstream(folder / "black") << std::string(2 * 27648, '\0');
  const BenchRun run =
      run_bench(std::string(kSmall) + "--json --modes lz4 --pictures " + (folder / "black").string());
  ASSERT_EQ(run.exit_code, 0);
  EXPECT_GT(json::parse(run.output)["modes"]["lz4"]["compression_ratio"].get<double>(), 50);
}

TEST(BenchReplay, AFlagThatCannotBeUsedIsNamedAndNothingRuns) {
  const test::ScratchFolder folder;
  std::ofstream(folder / "taken") << "x";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"--replay_gb 0", "--replay_gb"},
      {"--replay_gb many", "--replay_gb"},
      {"--seconds -1", "--seconds"},
      {"--num_agents 9", "--num_agents"},
      {"--rollout 0", "--rollout"},
      {"--batch 0", "--batch"},
      {"--modes disk", "--modes"},
      {"--modes mapped", "--replay_file"},
      {"--no_such_flag", "--no_such_flag"},
      {"--replay_gb 0.001", "holds not one trajectory"},
      {"--pictures /no/such/file", "/no/such/file"},
      {"--modes mapped --replay_gb 0.02 --replay_file /no/such/folder/ring", "folder does not exist"},
      {"--modes mapped --replay_gb 0.02 --replay_file " + (folder / "taken").string(), "taken"},
  };
  for (const auto& [flags, expected] : cases) {
    const BenchRun run = run_bench(flags + " 2>&1");
    EXPECT_EQ(run.exit_code, 2) << flags;
    EXPECT_THAT(run.output, HasSubstr(expected)) << flags;
  }
  const BenchRun huge = run_bench("--replay_gb 900000 --modes ram 2>&1");
  EXPECT_EQ(huge.exit_code, 1);
  EXPECT_THAT(huge.output, HasSubstr("only"));
}

}  // namespace bench_replay_test
}  // namespace comrad::replay
