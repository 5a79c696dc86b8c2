// What a run of one host opens: shared memory and a socket of this host, and nothing of a network.
#include "deploy/launch/run_resources.h"

#include <dirent.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <vector>

#include "deploy/launch/progress.h"

namespace comrad::deploy {
namespace run_resources_test {

constexpr int kRuns = 200;

LaunchPlan smallest_plan() {
  LaunchPlan plan;
  plan.env.num_agents = 1;
  plan.env.head_count = 1;
  plan.env.head_sizes[0] = 3;
  plan.env.height = plan.env.width = 8;
  plan.config.collection.num_workers = 1;
  plan.config.collection.num_envs_per_worker = 2;
  plan.config.collection.worker_num_splits = 1;
  plan.config.collection.policy_workers = 1;
  plan.config.collection.trajectory_slabs = 4;
  plan.policy = PolicySource::kRandom;
  return plan;
}

/// Sockets of this process that are not of this host alone.
int network_sockets() {
  int found = 0;
  DIR* descriptors = opendir("/proc/self/fd");
  while (const dirent* entry = readdir(descriptors)) {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    if (entry->d_name[0] != '.' &&
        getsockname(std::atoi(entry->d_name), reinterpret_cast<sockaddr*>(&address), &size) == 0)
      found += address.ss_family != AF_UNIX;
  }
  closedir(descriptors);
  return found;
}

/// Opens the resources of a run, writes a byte, and keeps them until `held` ends. The exit code.
int open_one(const LaunchPlan& plan, int opened, int held) {
  ProgressPrinter printer(STDERR_FILENO, /*show=*/false);
  RunResources resources(plan, printer);
  if (const Status made = resources.open(); !made) {
    std::fprintf(stderr, "%s\n", made.error().message.c_str());
    return 2;
  }
  char byte = 0;
  if (write(opened, &byte, 1) != 1 || read(held, &byte, 1) != 0) return 3;
  return network_sockets() == 0 ? 0 : 4;
}

TEST(RunResources, TwoHundredRunsOpenAtOnceAndNoneOpensASocketOfANetwork) {
  const LaunchPlan plan = smallest_plan();
  int opened[2], held[2];
  ASSERT_EQ(pipe(opened), 0);
  ASSERT_EQ(pipe(held), 0);
  std::vector<pid_t> runs;
  for (int run = 0; run < kRuns; ++run) {
    runs.push_back(fork());
    ASSERT_GE(runs.back(), 0);
    if (runs.back() > 0) continue;
    close(opened[0]);
    close(held[1]);
    _exit(open_one(plan, opened[1], held[0]));
  }
  close(opened[1]);
  close(held[0]);
  int open = 0;
  for (char byte; open < kRuns && read(opened[0], &byte, 1) == 1;) ++open;
  EXPECT_EQ(open, kRuns) << "of the runs were open at once";
  close(held[1]);
  for (const pid_t run : runs) {
    int status = 0;
    EXPECT_EQ(waitpid(run, &status, 0), run);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  close(opened[0]);
}

}  // namespace run_resources_test
}  // namespace comrad::deploy
