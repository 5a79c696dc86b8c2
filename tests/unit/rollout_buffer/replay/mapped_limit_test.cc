// A replay four times as large as the memory its process may use: it must read at least half as fast as the
// disk reads one file from its beginning. The limit is a control group's, version 2 or 1; without the right
// to make one the test skips.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>

#include "tests/unit/rollout_buffer/replay/bench_replay_run.h"
#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace mapped_limit_test {

constexpr int64_t kLimitBytes = int64_t{128} << 20;
constexpr int kAttempts = 3;  // a shared disk has bad seconds

/// A control group below our own with a limit of memory; goes away with this object.
class MemoryGroup {
 public:
  static std::optional<MemoryGroup> create(int64_t limit_bytes) {
    std::ifstream groups("/proc/self/cgroup");
    for (std::string line; std::getline(groups, line);) {
      const std::size_t first = line.find(':'), second = line.find(':', first + 1);
      if (second == std::string::npos) continue;
      const std::string controllers = line.substr(first + 1, second - first - 1);
      if (!controllers.empty() && controllers != "memory") continue;
      const std::string own =
          (controllers.empty() ? "/sys/fs/cgroup" : "/sys/fs/cgroup/memory") + line.substr(second + 1);
      MemoryGroup group;
      const std::string path = own + "/comrad-test-" + std::to_string(getpid());
      if (mkdir(path.c_str(), 0755) != 0) continue;
      group.path_ = path;
      const std::string limit = path + (controllers.empty() ? "/memory.max" : "/memory.limit_in_bytes");
      if (access(limit.c_str(), W_OK) != 0) continue;
      std::ofstream file(limit);
      file << limit_bytes << std::flush;
      if (file) return group;
    }
    return std::nullopt;
  }
  MemoryGroup(MemoryGroup&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  MemoryGroup& operator=(MemoryGroup&&) = delete;
  ~MemoryGroup() {
    // The last process of a group needs a moment to leave it.
    for (int i = 0; i < 100 && !path_.empty() && rmdir(path_.c_str()) != 0; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const std::string& path() const { return path_; }

 private:
  MemoryGroup() = default;
  std::string path_;
};

TEST(MappedReplay, FourTimesTheMemoryLimitReadsAtHalfTheDisksRateOrMore) {
  const std::optional<MemoryGroup> group = MemoryGroup::create(kLimitBytes);
  if (!group) GTEST_SKIP() << "no right to make a control group with a limit of memory";
  const test::ScratchFolder folder;
  const std::string flags = "--json --modes mapped --seconds 2 --batch 8 --replay_gb " +
                            std::to_string(4e-9 * static_cast<double>(kLimitBytes)) + " --replay_file " +
                            (folder / "ring").string();
  double best = 0;
  for (int attempt = 0; attempt < kAttempts && best < 0.5; ++attempt) {
    const BenchRun run = run_bench(flags, "echo $$ > " + group->path() + "/cgroup.procs && ");
    ASSERT_EQ(run.exit_code, 0) << run.output;
    const nlohmann::json report = nlohmann::json::parse(run.output)["modes"]["mapped"];
    ASSERT_GT(report["capacity_bytes"].get<int64_t>(), 4 * kLimitBytes - 1000);
    best = std::max(best, report["sequences_read"]["of_sequential"].get<double>());
    std::printf("sequences %.2f GB/s, sequential %.2f GB/s: %.2f\n",
                report["sequences_read"]["gb_per_s"].get<double>(),
                report["sequential_gb_per_s"].get<double>(),
                report["sequences_read"]["of_sequential"].get<double>());
  }
  EXPECT_GE(best, 0.5);
}

}  // namespace mapped_limit_test
}  // namespace comrad::replay
