// A run on one host needs no network: no process of it opens a socket of one, and it trains where there is none.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <set>
#include <sstream>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace one_host_test {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

/// The inodes of all sockets of IPv4 and IPv6 that this host has.
std::set<std::string> network_inodes() {
  std::set<std::string> inodes;
  for (const char* kind : {"udp", "udp6", "tcp", "tcp6", "raw"}) {
    std::istringstream lines(read_text(std::string("/proc/net/") + kind));
    std::string line;
    for (std::getline(lines, line); std::getline(lines, line);) {
      std::istringstream words(line);
      std::string inode;
      for (int word = 0; word < 10; ++word) words >> inode;
      inodes.insert(inode);
    }
  }
  return inodes;
}

std::vector<std::string> sockets_of(pid_t process) {
  std::vector<std::string> inodes;
  std::error_code gone;
  for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(process) + "/fd", gone)) {
    const std::string target = fs::read_symlink(entry.path(), gone).string();
    if (target.starts_with("socket:[")) inodes.push_back(target.substr(8, target.size() - 9));
  }
  return inodes;
}

TEST(OneHost, NoProcessOfARunOpensASocketOfANetworkAndWorkersDoNotLoadDds) {
  const ScratchFolder scratch;
  RunningProgram training(small_training(scratch, "run", 1e9));
  ASSERT_TRUE(wait_until([&] { return env_frames(scratch / "run") > 0 || !training.running(); }));
  ASSERT_TRUE(training.running()) << training.wait().err;
  const std::set<std::string> network = network_inodes();
  std::vector<pid_t> processes = processes_of(scratch / "run");
  ASSERT_GE(processes.size(), 3u) << "a simulator, a policy worker and the learner";
  for (const pid_t worker : processes)
    EXPECT_THAT(read_text("/proc/" + std::to_string(worker) + "/maps"), Not(HasSubstr("libddsc")))
        << read_text("/proc/" + std::to_string(worker) + "/comm");
  processes.push_back(training.pid());
  for (const pid_t process : processes)
    for (const std::string& inode : sockets_of(process))
      EXPECT_FALSE(network.contains(inode)) << read_text("/proc/" + std::to_string(process) + "/comm");
  training.signal(SIGTERM);
  EXPECT_EQ(training.wait().exit_code, 0);
}

TEST(OneHost, TrainsWithABrokenCycloneDdsConfiguration) {
  const ScratchFolder scratch;
  const Ending ending =
      RunningProgram(small_training(scratch, "run", 2048), {{"CYCLONEDDS_URI", "<CycloneDDS><nonsense"}})
          .wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.err, Not(HasSubstr("DDS")));
  EXPECT_GE(env_frames(scratch / "run"), 2048);
}

TEST(OneHost, TrainsWhereNoNetworkInterfaceIsUpNotEvenLoopback) {
  const std::vector<std::string> apart = {"/usr/bin/unshare", "--map-root-user", "--net", "--"};
  std::vector<std::string> probe = apart;
  probe.push_back("/bin/true");
  if (RunningProgram(probe).wait().exit_code != 0) GTEST_SKIP() << "this host allows no network namespaces";
  const ScratchFolder scratch;
  std::vector<std::string> command = apart;
  for (const std::string& word : small_training(scratch, "run", 2048)) command.push_back(word);
  const Ending ending = RunningProgram(command).wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_GE(env_frames(scratch / "run"), 2048);
}

}  // namespace one_host_test
}  // namespace comrad::test
