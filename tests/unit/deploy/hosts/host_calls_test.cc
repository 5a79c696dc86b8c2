#include "deploy/hosts/host_calls.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

namespace comrad::deploy {
namespace host_calls_test {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

Variable variables(std::map<std::string, std::string> values) {
  return [values](const char* name) {
    const auto found = values.find(name);
    return found == values.end() ? std::string() : found->second;
  };
}

const std::map<std::string, std::string> kTwoTasks = {
    {"SLURM_JOB_ID", "7"}, {"SLURM_NTASKS", "2"}, {"SLURM_JOB_NUM_NODES", "1"}, {"SLURM_CPUS_PER_TASK", "3"}};

TEST(HostCalls, AJobsScriptOfSeveralTasksCallsAndAStepOfSrunDoesNot) {
  EXPECT_TRUE(is_alone_in_an_allocation(variables(kTwoTasks)));
  auto step = kTwoTasks;
  step["SLURM_STEP_ID"] = "0";
  EXPECT_FALSE(is_alone_in_an_allocation(variables(step)));
  step["SLURM_STEP_ID"] = "4294967290";  // salloc's shell
  EXPECT_TRUE(is_alone_in_an_allocation(variables(step)));
  auto one = kTwoTasks;
  one["SLURM_NTASKS"] = "1";
  EXPECT_FALSE(is_alone_in_an_allocation(variables(one)));
  EXPECT_FALSE(is_alone_in_an_allocation(variables({})));
}

TEST(HostCalls, InAnAllocationSrunStartsTheOtherTasks) {
  RunConfig config;
  ASSERT_TRUE(prepare_calls(config, variables(kTwoTasks)));
  EXPECT_TRUE(config.hosts.serve);
  const std::vector<HostStart> calls = host_calls(config, variables(kTwoTasks), "/opt/comrad");
  ASSERT_EQ(calls.size(), 1u);
  EXPECT_EQ(calls[0].command[0], "srun");
  EXPECT_THAT(calls[0].command, Contains("--ntasks=1"));
  EXPECT_THAT(calls[0].command, Contains("--cpus-per-task=3"));
  EXPECT_THAT(calls[0].command, Contains("/opt/comrad"));
  EXPECT_THAT(calls[0].command, Contains("--leave_with_input"));
  EXPECT_THAT(calls[0].command, Not(Contains("--insecure_network")));
  EXPECT_THAT(calls[0].command, Not(Contains(HasSubstr("--keys"))));
  config.hosts.host_keys = "/etc/keys/%h";
  EXPECT_THAT(host_calls(config, variables(kTwoTasks), "/opt/comrad")[0].command,
              Contains("--keys=/etc/keys/%h"));
}

TEST(HostCalls, NoneOrLockStepCallsNoHost) {
  RunConfig config;
  config.hosts.hosts = "none";
  ASSERT_TRUE(prepare_calls(config, variables(kTwoTasks)));
  EXPECT_FALSE(config.hosts.serve);
  EXPECT_THAT(host_calls(config, variables(kTwoTasks), "/opt/comrad"), IsEmpty());
  RunConfig lock_step;
  lock_step.collection.deterministic = true;
  ASSERT_TRUE(prepare_calls(lock_step, variables(kTwoTasks)));
  EXPECT_FALSE(lock_step.hosts.serve);
}

TEST(HostCalls, SshPromptsForNothingAndQuotesWhatAShellReads) {
  RunConfig config;
  config.hosts.serve = true;
  config.hosts.hosts = "a,me@b";
  config.hosts.insecure_network = true;
  const std::vector<HostStart> calls = host_calls(config, variables({}), "/home/it's here/comrad");
  ASSERT_EQ(calls.size(), 2u);
  EXPECT_EQ(calls[0].name, "host a");
  EXPECT_THAT(calls[0].command, Contains("BatchMode=yes"));
  EXPECT_EQ(calls[1].command[calls[1].command.size() - 2], "me@b");
  EXPECT_THAT(calls[1].command.back(), HasSubstr("exec '/home/it'\\''s here/comrad' 'join' '-'"));
  EXPECT_THAT(calls[1].command.back(), HasSubstr("'--insecure_network'"));
  EXPECT_THAT(calls[1].command.back(), HasSubstr("else exec comrad 'join'"));
}

TEST(HostCalls, AHostWithoutAnAddressIsNamed) {
  RunConfig config;
  config.hosts.hosts = "no-such-host.invalid";
  const Status prepared = prepare_calls(config, variables({}));
  ASSERT_FALSE(prepared);
  EXPECT_THAT(prepared.error().message, HasSubstr("no-such-host.invalid"));
}

TEST(HostCalls, AHostThatIsThisOneIsReachedOnLoopback) {
  RunConfig config;
  config.hosts.hosts = "me@127.0.0.1";
  ASSERT_TRUE(prepare_calls(config, variables({})));
  EXPECT_EQ(config.hosts.interface, "lo");
}

}  // namespace host_calls_test
}  // namespace comrad::deploy
