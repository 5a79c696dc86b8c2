#include "rollout_buffer/core/cores.h"

#include <gtest/gtest.h>
#include <sched.h>

#include <thread>

#include "tests/support/scratch_folder.h"

namespace comrad {
namespace cores_test {

std::optional<double> quota_of(const std::string& proc_cgroup, const std::string& root) {
  return control_group_cores(control_groups("cpu", proc_cgroup, root));
}

TEST(AllowedCpus, AreThoseOfTheMask) {
  std::thread([] {
    const std::vector<int> before = allowed_cpus();
    ASSERT_FALSE(before.empty());
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(static_cast<std::size_t>(before.back()), &one);
    ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);  // of this thread alone
    EXPECT_EQ(allowed_cpus(), std::vector<int>{before.back()});
    EXPECT_EQ(usable_cores(), 1);
  }).join();
}

TEST(ControlGroupCores, TakesTheTightestQuotaOfVersion2OnTheWayUp) {
  const test::ScratchFolder root;
  root.write("cpu.max", std::string_view("max 100000\n"));
  root.write("a/cpu.max", std::string_view("250000 100000\n"));
  root.write("a/b/cpu.max", std::string_view("400000 100000\n"));
  EXPECT_EQ(quota_of("0::/a/b\n", root.string()), 2.5);
  EXPECT_EQ(quota_of("0::/\n", root.string()), std::nullopt);
}

TEST(ControlGroupCores, InAContainerTheMountItselfIsTheGroup) {
  const test::ScratchFolder root;
  root.write("cpu.max", std::string_view("50000 100000\n"));
  EXPECT_EQ(quota_of("0::/kubepods/pod17/4a5b\n", root.string()), 0.5);
}

TEST(ControlGroupCores, ReadsTheCpuHierarchyOfVersion1) {
  const test::ScratchFolder root;
  root.write("cpu/job/cpu.cfs_quota_us", std::string_view("150000\n"));
  root.write("cpu/job/cpu.cfs_period_us", std::string_view("50000\n"));
  root.write("cpu/cpu.cfs_quota_us", std::string_view("-1\n"));
  root.write("cpu/cpu.cfs_period_us", std::string_view("100000\n"));
  EXPECT_EQ(quota_of("4:cpu,cpuacct:/job\n3:cpuset:/other\n", root.string()), 3.0);
  EXPECT_EQ(quota_of("3:cpuset:/job\n", root.string()), std::nullopt);
}

TEST(MemoryKills, AreCountedInBothVersions) {
  const test::ScratchFolder root;
  root.write("a/memory.events", std::string_view("low 0\nhigh 0\nmax 9\noom 4\noom_kill 3\n"));
  root.write("memory/job/memory.oom_control",
             std::string_view("oom_kill_disable 0\nunder_oom 0\noom_kill 2\n"));
  EXPECT_EQ(memory_kills(control_groups("memory", "0::/a\n", root.string())), 3u);
  EXPECT_EQ(memory_kills(control_groups("memory", "7:memory:/job\n", root.string())), 2u);
  EXPECT_EQ(memory_kills(control_groups("memory", "0::/none\n", root.string())), 0u);
}

TEST(ControlGroupCores, WhatCannotBeReadIsNoLimit) {
  const test::ScratchFolder root;
  root.write("cpu.max", std::string_view("nonsense"));
  for (const char* text : {"", "\n", "0", "0:", "0::", "0::/..", "4:cpu:"})
    EXPECT_EQ(quota_of(text, root.string()), std::nullopt) << text;
}

}  // namespace cores_test
}  // namespace comrad
