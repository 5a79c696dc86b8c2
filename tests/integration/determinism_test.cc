// --deterministic: the same seed gives the same weights bit for bit, twice, after a resume half way, and
// after a worker was killed.

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <csignal>
#include <filesystem>

#include "learner/checkpoint/checkpoint.h"
#include "tests/integration/running_program.h"
#include "tests/support/same_value.h"

namespace comrad::test {
namespace determinism_test {

constexpr double kEnvSteps = 8192;
/// Of a run that is to be disturbed: seconds on a fast machine, whose status is written once a second.
constexpr double kManyEnvSteps = 4 * kEnvSteps;

std::vector<std::string> lock_step(const ScratchFolder& scratch, const std::string& experiment,
                                   double env_steps, const std::vector<std::string>& more = {}) {
  std::vector<std::string> all = {"--deterministic=True"};
  all.insert(all.end(), more.begin(), more.end());
  return small_training(scratch, experiment, env_steps, all);
}

void train(const ScratchFolder& scratch, const std::string& experiment, double env_steps,
           const std::vector<std::string>& more = {}) {
  const Ending ending = RunningProgram(lock_step(scratch, experiment, env_steps, more)).wait();
  ASSERT_FALSE(ending.timed_out) << ending.err;
  ASSERT_EQ(ending.exit_code, 0) << ending.err;
}

/// The newest checkpoint of a run.
learn::StateDict last_checkpoint(const std::string& run) {
  const auto checkpoints = learn::CheckpointStore(run + "/checkpoint", 1).list();
  if (checkpoints.empty()) return {};
  auto state = learn::read_checkpoint(checkpoints.front().path);
  EXPECT_TRUE(state) << state.error().message;
  return state ? *state : learn::StateDict();
}

/// Networks, optimizer, normalizers, schedules: everything that training made. Times and paths are not.
bool is_trained(const std::string& key) {
  for (const char* section : {"network/", "optimizer/", "normalizer/", "schedule/", "algorithm/", "target/",
                              "mixer/", "target_mixer/"})
    if (key.starts_with(section)) return true;
  return key == "counters/env_frames";
}

/// Compares two runs' last checkpoints bit for bit; returns how many values were compared.
size_t expect_same_training(const std::string& run_a, const std::string& run_b) {
  const learn::StateDict a = last_checkpoint(run_a), b = last_checkpoint(run_b);
  size_t compared = 0;
  EXPECT_EQ(a.values().size(), b.values().size());
  for (const auto& [key, value] : a.values()) {
    if (!is_trained(key)) continue;
    const auto other = b.values().find(key);
    if (other == b.values().end()) {
      ADD_FAILURE() << key << " is only in " << run_a;
      continue;
    }
    EXPECT_TRUE(test::same_value(value, other->second)) << key;
    ++compared;
  }
  return compared;
}

/// Whether any trained tensor differs.
bool differ(const std::string& run_a, const std::string& run_b) {
  const learn::StateDict a = last_checkpoint(run_a), b = last_checkpoint(run_b);
  for (const auto& [key, value] : a.values())
    if (key.starts_with("network/") && !test::same_value(value, b.values().at(key))) return true;
  return false;
}

/// An undisturbed run that several tests compare with; the first that requests it makes it.
std::string undisturbed(double env_steps) {
  static const ScratchFolder scratch;
  const std::string experiment = "undisturbed_" + std::to_string(static_cast<int>(env_steps));
  if (!std::filesystem::exists(scratch / experiment)) train(scratch, experiment, env_steps);
  return scratch / experiment;
}

TEST(Deterministic, AnotherSeedGivesOtherWeights) {
  const ScratchFolder scratch;
  train(scratch, "other_seed", kEnvSteps, {"--seed", "43"});
  EXPECT_TRUE(differ(undisturbed(kEnvSteps), scratch / "other_seed"));
}

TEST(Deterministic, ResumingHalfWayEqualsNeverStopping) {
  const ScratchFolder scratch;
  train(scratch, "resumed", kEnvSteps / 2);
  train(scratch, "resumed", kEnvSteps);
  EXPECT_GT(expect_same_training(undisturbed(kEnvSteps), scratch / "resumed"), 20u);
}

TEST(Deterministic, SchedulesAndStagesOfRewardsContinueExactlyAfterAResume) {
  const ScratchFolder scratch;
  // Each moves before, at and after the half.
  const std::vector<std::string> settings = {"--reward",
                                             "health_lost=-0.5@0..-0.01@8192,kit_taken=0@0,1@2048,0.3@6144",
                                             "--learning_rate",
                                             "2e-3@0..1e-4@8192",
                                             "--exploration_loss_coeff",
                                             "0.02@0,0.001@4096",
                                             "--ppo_clip_ratio",
                                             "0.3@1024..0.1@7168"};
  train(scratch, "straight", kEnvSteps, settings);
  train(scratch, "resumed", kEnvSteps / 2, settings);
  train(scratch, "resumed", kEnvSteps);
  EXPECT_GT(expect_same_training(scratch / "straight", scratch / "resumed"), 20u);
  EXPECT_TRUE(differ(undisturbed(kEnvSteps), scratch / "straight"));
}

TEST(DeterministicLong, MappoAndHappoResumedHalfWayEqualNeverStopping) {
  const ScratchFolder scratch;
  for (const std::string algo : {"mappo", "happo"}) {
    // HAPPO's own schedule ends with the run, and the half run is over earlier.
    const std::vector<std::string> settings = {
        "--algo",        algo,       "--critic_hidden_sizes", "64,32",
        "--lr_schedule", "constant", "--critic_state",        "global"};
    train(scratch, algo + "_straight", kEnvSteps, settings);
    train(scratch, algo + "_resumed", kEnvSteps / 2, settings);
    train(scratch, algo + "_resumed", kEnvSteps, settings);
    EXPECT_GT(expect_same_training(scratch / (algo + "_straight"), scratch / (algo + "_resumed")), 20u)
        << algo;
  }
}

/// Batches of four worlds, of which each learner has two, and micro-batches of two. The settings of two learners.
std::vector<std::string> expect_two_learners_to_equal_one(const ScratchFolder& scratch,
                                                          const std::string& algo) {
  std::vector<std::string> settings = {"--algo",
                                       algo,
                                       "--critic_hidden_sizes",
                                       "64,32",
                                       "--batch_size",
                                       "128",
                                       "--micro_batch_size",
                                       "64",
                                       "--learner_threads",
                                       "1",
                                       "--num_epochs",
                                       "2"};
  train(scratch, algo + "_one", kEnvSteps, settings);
  settings.insert(settings.end(), {"--learners", "2"});
  train(scratch, algo + "_two", kEnvSteps, settings);
  EXPECT_GT(expect_same_training(scratch / (algo + "_one"), scratch / (algo + "_two")), 20u) << algo;
  return settings;
}

TEST(Deterministic, PolicyWorkersAsThreadsOfTheLearnerGiveTheSameWeights) {
  const ScratchFolder scratch;
  train(scratch, "threads", kEnvSteps, {"--policy_processes", "False", "--policy_workers", "2"});
  EXPECT_GT(expect_same_training(undisturbed(kEnvSteps), scratch / "threads"), 20u);
}

TEST(Deterministic, TwoLearnersGiveTheWeightsOfOneThatAddsTheSameMicroBatches) {
  const ScratchFolder scratch;
  expect_two_learners_to_equal_one(scratch, "ippo");
}

TEST(DeterministicLong, TwoLearnersOfMappoAndTwoThatAreResumed) {
  const ScratchFolder scratch;
  expect_two_learners_to_equal_one(scratch, "mappo");
  const std::vector<std::string> settings = expect_two_learners_to_equal_one(scratch, "ippo");
  train(scratch, "ippo_resumed", kEnvSteps / 2, settings);
  train(scratch, "ippo_resumed", kEnvSteps, settings);
  EXPECT_GT(expect_same_training(scratch / "ippo_two", scratch / "ippo_resumed"), 20u);
}

TEST(DeterministicLong, QmixIdqnAndTwoLearnersOfVdnResumedHalfWayEqualNeverStopping) {
  const ScratchFolder scratch;
  for (const std::string algo : {"qmix", "idqn", "vdn"}) {
    const std::vector<std::string> settings = {"--algo",
                                               algo,
                                               "--learners",
                                               algo == "vdn" ? "2" : "1",
                                               "--learning_starts_decisions",
                                               "200",
                                               "--qmix_batch_sequences",
                                               "4",
                                               "--replay_gb",
                                               "0.05",
                                               "--dqn_batch_decisions",
                                               "32",
                                               "--replay_ratio",
                                               "1",
                                               "--critic_state",
                                               "global",
                                               "--per_beta_env_frames",
                                               "8192"};  // else the half run is over earlier
    train(scratch, algo + "_straight", kEnvSteps, settings);
    train(scratch, algo + "_resumed", kEnvSteps / 2, settings);
    train(scratch, algo + "_resumed", kEnvSteps, settings);
    EXPECT_GT(expect_same_training(scratch / (algo + "_straight"), scratch / (algo + "_resumed")), 20u)
        << algo;
    EXPECT_GT(*last_checkpoint(scratch / (algo + "_straight")).integer("algorithm/version"), 3) << algo;
  }
}

TEST(DeterministicLong, AnInterruptedAndResumedRunEqualsNeverStopping) {
  const ScratchFolder scratch;
  {
    RunningProgram interrupted(lock_step(scratch, "resumed", kManyEnvSteps));
    ASSERT_TRUE(wait_until([&] { return env_frames(scratch / "resumed") > 0; }));
    interrupted.signal(SIGINT);
    ASSERT_EQ(interrupted.wait().exit_code, 0);
  }
  train(scratch, "resumed", kManyEnvSteps);
  EXPECT_GT(expect_same_training(undisturbed(kManyEnvSteps), scratch / "resumed"), 20u);
}

TEST(Deterministic, AKilledSimulatorChangesNothing) {
  // A run that was over before its simulator could be killed is played again, four times as long.
  for (double steps = kManyEnvSteps; steps <= 64 * kManyEnvSteps; steps *= 4) {
    const ScratchFolder scratch;
    RunningProgram disturbed(lock_step(scratch, "disturbed", steps));
    ASSERT_TRUE(wait_until([&] { return env_frames(scratch / "disturbed") > 0; }));
    const auto simulators = processes_of(scratch / "disturbed", "comrad-sim-worker");
    if (!simulators.empty()) kill(simulators[0], SIGKILL);
    const Ending ending = disturbed.wait();
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    if (ending.err.find("died") == std::string::npos) continue;
    EXPECT_GT(expect_same_training(undisturbed(steps), scratch / "disturbed"), 20u);
    return;
  }
  FAIL() << "no run reported that its simulator died";
}

}  // namespace determinism_test
}  // namespace comrad::test
