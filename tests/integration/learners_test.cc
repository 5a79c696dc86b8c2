// --learners N: several learner processes train one run, live and die together, and refuse what they cannot share.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <fstream>

#include "tests/integration/decision_accounts.h"
#include "tests/integration/running_program.h"

namespace comrad::test {
namespace learners_test {

using ::testing::HasSubstr;

std::vector<std::string> two_learners(const ScratchFolder& scratch, double env_steps,
                                      const std::vector<std::string>& more = {}) {
  std::vector<std::string> all = {"--learners", "2", "--learner_threads", "1", "--save_every_sec", "1"};
  all.insert(all.end(), more.begin(), more.end());
  return small_training(scratch, "run", env_steps, all);
}

/// The number in a line of /proc/PID/status.
int64_t status_number(pid_t pid, const std::string& name) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(name + ":")) return std::stoll(line.substr(name.size() + 1));
  return -1;
}

/// The first learner and those that it made.
struct Learners {
  pid_t first = -1;
  std::vector<pid_t> others;
};
Learners learners_of(const std::string& run) {
  Learners found;
  const std::vector<pid_t> all = processes_of(run, "comrad-learner");
  for (const pid_t pid : all) {
    const auto parent = static_cast<pid_t>(status_number(pid, "PPid"));
    if (std::ranges::find(all, parent) != all.end())
      found.others.push_back(pid);
    else
      found.first = pid;
  }
  return found;
}

/// Kills one of two learners, once there is a checkpoint, and waits until both are new ones.
void expect_new_learners_where_one_dies(const std::string& run, bool is_first) {
  ASSERT_TRUE(wait_until([&] { return !files(run + "/checkpoint", "checkpoint_", ".pt").empty(); }));
  const Learners before = learners_of(run);
  ASSERT_GT(before.first, 0);
  ASSERT_EQ(before.others.size(), 1u);
  kill(is_first ? before.first : before.others[0], SIGKILL);
  ASSERT_TRUE(wait_until([&] {
    const Learners now = learners_of(run);
    return now.first > 0 && now.first != before.first && now.others.size() == 1 &&
           now.others[0] != before.others[0];
  })) << read_text(run + "/logs/supervisor.log");
}

/// Ends a run by SIGTERM, which leaves nothing. The account of its decisions.
nlohmann::json account_of_stopped(RunningProgram& training, const std::string& run) {
  training.signal(SIGTERM);
  const Ending ending = training.wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_TRUE(wait_until([&] { return processes_of(run).empty(); })) << "something is left";
  return checked_account(run);
}

/// Whether a run learns so many env frames beyond what it has now.
bool learns_on(const std::string& run, double frames) {
  const double before = env_frames(run);
  return wait_until([&] { return env_frames(run) >= before + frames; });
}

TEST(Learners, TrainToTheEndAndEveryDecisionOfBothIsCounted) {
  const ScratchFolder scratch;
  const Ending ending = RunningProgram(two_learners(scratch, 10000)).wait();
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  const std::string run = scratch / "run";
  EXPECT_GE(env_frames(run), 10000);
  EXPECT_TRUE(processes_of(run).empty());
  const nlohmann::json account = checked_account(run);
  EXPECT_EQ(account["trained"].get<int64_t>() * 4, static_cast<int64_t>(env_frames(run)));
  EXPECT_EQ(account["trained"].get<int64_t>() % 256, 0) << "whole batches of both";
  EXPECT_THAT(read_text(run + "/logs/learner-1.log"), HasSubstr("learner 1 of 2 trains on cpu"));
  EXPECT_THAT(read_text(run + "/logs/learner-1.log"), HasSubstr("stopped"));
  // One continues from what two saved.
  const double frames = env_frames(run);
  const Ending alone = RunningProgram(two_learners(scratch, frames + 4096, {"--learners", "1"})).wait();
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  EXPECT_THAT(read_text(run + "/logs/learner-0.log"), HasSubstr("resumed from"));
  EXPECT_GE(env_frames(run), frames + 4096);
}

TEST(Learners, WhereOneDiesAllBeginAgainFromTheLastCheckpoint) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run";
  RunningProgram training(two_learners(scratch, 1e9));
  ASSERT_TRUE(wait_until([&] { return env_frames(run) > 0 || !training.running(); }));
  ASSERT_TRUE(training.running()) << training.wait().err;
  // The second one, and the first.
  for (const bool is_first : {false, true}) {
    ASSERT_TRUE(learns_on(run, 4096));
    ASSERT_NO_FATAL_FAILURE(expect_new_learners_where_one_dies(run, is_first));
  }
  ASSERT_TRUE(learns_on(run, 4096));
  const nlohmann::json account = account_of_stopped(training, run);
  EXPECT_GT(account["lost_with_learners"].get<int64_t>() + account["forgotten"].get<int64_t>(), 0);
  EXPECT_THAT(read_text(run + "/logs/learner-0.log"),
              HasSubstr("learner 1 of 2 was killed by signal 9 (Killed); all learners begin again"));
  EXPECT_THAT(read_text(run + "/logs/learner-0.log"), HasSubstr("resumed from"));
}

/// Q-learning that begins soon, with small batches.
std::vector<std::string> two_q_learners(const ScratchFolder& scratch, const std::string& algo,
                                        double env_steps) {
  return two_learners(scratch, env_steps,
                      {"--algo", algo, "--learning_starts_decisions", "500", "--qmix_batch_sequences", "4",
                       "--dqn_batch_decisions", "32", "--replay_ratio", "1", "--replay_gb", "0.05"});
}

TEST(Learners, OfQlearningTrainToTheEndFromSeparateReplays) {
  const ScratchFolder scratch;
  const Ending ending = RunningProgram(two_q_learners(scratch, "qmix", 8000)).wait();
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.err, HasSubstr("each of 2 learners holds a part of it"));
  const std::string run = scratch / "run";
  EXPECT_TRUE(processes_of(run).empty());
  const nlohmann::json account = checked_account(run);
  EXPECT_EQ(account["trained"].get<int64_t>() * 4, static_cast<int64_t>(env_frames(run)));
  const nlohmann::json last = read_json_lines(run + "/metrics.jsonl").back();
  EXPECT_GT(last["train/num_sgd_steps"].get<double>(), 0);
  EXPECT_GT(last["train/buffer_transitions"].get<double>(), 1000) << "of both";
  EXPECT_THAT(read_text(run + "/logs/learner-1.log"), HasSubstr("stopped"));
}

TEST(Learners, RefuseWhatTheyCannotShare) {
  const ScratchFolder scratch;
  const auto refusal = [&](const std::vector<std::string>& more) {
    const Ending ending = RunningProgram(two_learners(scratch, 1000, more)).wait();
    EXPECT_EQ(ending.exit_code, 2);
    return ending.err;
  };
  EXPECT_THAT(
      refusal({"--algo", "qmix", "--qmix_batch_sequences", "7"}),
      HasSubstr("learners is 2; an update's 7 sequences are not divided by it without a remainder; set "
                "--replay_batch_size 8"));
  EXPECT_THAT(
      refusal({"--learners", "3"}),
      HasSubstr("learners is 3; a batch of 8 trajectories (batch_size x num_batches_per_epoch / "
                "(rollout x num_agents)) is not divided by it without a remainder; set --batch_size 288"));
  EXPECT_THAT(refusal({"--num_batches_per_epoch", "2", "--batch_size", "96"}),
              HasSubstr("each has 3 trajectories of a batch"));
}

}  // namespace learners_test
}  // namespace comrad::test
