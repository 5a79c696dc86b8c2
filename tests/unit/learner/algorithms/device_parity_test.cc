// The same weights and the same batch on the CPU and on another device: logits, losses, gradients and the weights after one
// optimizer step agree. COMRAD_TEST_DEVICE names the device (deploy/gpu/check.sh: cuda); without it a second learner on the
// CPU is compared, which must be equal bit for bit, and one that takes a GPU's path there. The largest differences are
// properties of the test's report.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <string>
#include <variant>

#include "learner/algorithms/algorithm.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "tests/support/noise_batch.h"
#include "tests/support/test_device.h"

namespace comrad::learn {
namespace device_parity_test {

constexpr int kAgents = 2, kWorlds = 4;

RunConfig parity_config(const std::string& algo) {
  RunConfig config = test::small_config(algo, kAgents);
  config.mixers.mixer = algo == "vdn"       ? "vdn"
                        : algo == "qmix"    ? "qmix"
                        : algo == "qplex_d" ? "dmaq"
                        : algo == "qplex_q" ? "dmaq_qatten"
                                            : "";
  config.q_learning.team_reward = TeamReward::kSum;
  config.network.normalize_input = true;
  config.optimisation.num_epochs = 1;
  config.optimisation.num_batches_per_epoch = 1;
  config.optimisation.learning_rate = 1e-3;
  return config;
}

/// What one learner made of one batch.
struct Outcome {
  Tensor logits;  ///< of the batch's first frames, before the step
  UpdateStats stats;
  StateDict state;  ///< after it
};

Tensor first_logits(const RunConfig& config, const EnvShape& env, torch::Device device, const Tensor& frame,
                    const Tensor& recurrent_state) {
  const policy::ActorCritic net =
      policy::ActorCritic::create(policy::NetworkOptions::from(config, env), 1, device);
  return net.step(frame.to(device), {}, recurrent_state.to(device)).logits.to(torch::kCPU);
}

/// Time ends the episode in three or four worlds, for which a device has one recording.
void cut_some_worlds(const test::SlabPool& pool, uint64_t seed) {
  constexpr int kCutStep = 1;
  for (int world = 0; world < static_cast<int>(3 + seed % 2); ++world) {
    const SlabView slab = pool.view(world);
    slab.truncated(kCutStep) = 1;
    slab.final_index(kCutStep) = 0;
    for (int agent = 0; agent < kAgents; ++agent)
      std::ranges::copy(slab.frame(world, agent), slab.final_frame(0, agent).begin());
  }
}

/// `updates` of them, each with its own batch; the outcome's numbers are of the last one.
Outcome train(const std::string& algo, torch::Device device, uint64_t seed, int updates = 1) {
  const RunConfig config = parity_config(algo);
  const TrajectoryShape shape = test::small_shape(config, kAgents);
  Outcome outcome;
  auto algorithm = make_algorithm(config, shape.env, device);
  EXPECT_TRUE(algorithm);
  for (int update = 0; update < updates; ++update, ++seed) {
    if (auto* on_policy = dynamic_cast<OnPolicyAlgorithm*>(algorithm->get())) {
      RolloutBatch batch = test::noise_batch(shape, kWorlds, seed);
      send_ahead(batch, device);
      outcome.logits = first_logits(config, shape.env, device, batch.frame[0], batch.recurrent_state);
      outcome.stats = *on_policy->update(batch, {});
      continue;
    }
    const test::SlabPool pool(shape, kWorlds);
    pool.fill_with_noise(seed);
    cut_some_worlds(pool, seed);
    auto replay = *replay::Replay::create({.store = {.shape = shape, .capacity_bytes = 1 << 24}});
    std::vector<replay::Draw> draws;
    const bool single = algo == "idqn" && !config.network.use_rnn;
    for (int item = 0; item < kWorlds; ++item) {
      replay->insert(pool.view(item), static_cast<uint32_t>(shape.rollout_steps));
      draws.push_back(
          {.item = item, .step = config.network.use_rnn ? -1 : 1, .agent = 0, .weight = 1.0, .serial = item});
    }
    const ReplayBatchOptions options{.shape = shape,
                                     .unit = config.network.use_rnn ? replay::Unit::kSequence
                                             : single               ? replay::Unit::kAgentStep
                                                                    : replay::Unit::kJointStep,
                                     .world_count = kWorlds,
                                     .n_step = config.q_learning.n_step.rounded_at(0),
                                     .pay = {.gamma = config.optimisation.gamma},
                                     .agents_end = algo == "idqn"};
    ReplayBatch batch = make_replay_batch(options);
    fill(batch, options, *replay, draws);
    auto* off_policy = dynamic_cast<OffPolicyAlgorithm*>(algorithm->get());
    off_policy->observe(batch.frame[0], {}, {});
    outcome.logits = first_logits(config, shape.env, device, batch.frame[0], batch.recurrent_state);
    outcome.stats = *off_policy->update(batch, {});
  }
  (*algorithm)->save(outcome.state);
  return outcome;
}

/// The largest and the mean difference of all floating tensors of a section whose key ends with a word.
struct Difference {
  double largest = 0, mean = 0, scale = 0;  ///< scale: the largest value
  int64_t count = 0;
};

Difference difference_of(const StateDict& one, const StateDict& other, const std::string& section,
                         const std::string& word) {
  Difference found;
  double sum = 0;
  for (const auto& [key, value] : one.values()) {
    const auto* tensor = std::get_if<Tensor>(&value);
    if (tensor == nullptr || !key.starts_with(section) || !key.ends_with(word) ||
        !tensor->is_floating_point() || tensor->numel() == 0)
      continue;
    const auto counterpart = other.tensor(key);
    EXPECT_TRUE(counterpart) << key;
    if (!counterpart) continue;
    const Tensor a = tensor->to(torch::kFloat64), gap = (a - counterpart->to(torch::kFloat64)).abs();
    found.largest = std::max(found.largest, gap.max().item<double>());
    found.scale = std::max(found.scale, a.abs().max().item<double>());
    sum += gap.sum().item<double>();
    found.count += gap.numel();
  }
  found.mean = found.count > 0 ? sum / static_cast<double>(found.count) : 0;
  return found;
}

class DeviceParity : public ::testing::TestWithParam<std::string> {
  const test::FullPrecision full_;  // differences are of rounding alone
};

/// Both made one step of the same batch.
void expect_agreement(const Outcome& cpu, const Outcome& other, bool is_exact) {
  ASSERT_GE(cpu.stats.optimizer_steps, 1);  // HAPPO counts each agent's and the critic's
  ASSERT_EQ(other.stats.optimizer_steps, cpu.stats.optimizer_steps);

  const double logits = (cpu.logits - other.logits).abs().max().item<double>();
  ::testing::Test::RecordProperty("logits_largest_difference", std::to_string(logits));
  EXPECT_LE(logits, is_exact ? 0 : 1e-4);

  const auto mine = test::values_of(cpu.stats), theirs = test::values_of(other.stats);
  int losses = 0;
  double worst = 0;
  for (const auto& [name, value] : mine) {
    if (name.find("loss") == std::string::npos) continue;
    ++losses;
    ASSERT_TRUE(theirs.contains(name)) << name;
    const double gap = std::abs(value - theirs.at(name)) / std::max(1.0, std::abs(value));
    worst = std::max(worst, gap);
    EXPECT_LE(gap, is_exact ? 0 : 1e-4) << name << ": " << value << ", " << theirs.at(name);
  }
  EXPECT_GE(losses, 1);
  ::testing::Test::RecordProperty("losses_largest_difference", std::to_string(worst));

  // Adam's first moment after one step is the clipped gradient times a constant.
  const Difference gradient = difference_of(cpu.state, other.state, "optimizer/", ".exp_avg");
  ASSERT_GT(gradient.count, 1000);
  ASSERT_GT(gradient.scale, 0);
  ::testing::Test::RecordProperty("gradient_largest_difference",
                                  std::to_string(gradient.largest / gradient.scale));
  EXPECT_LE(gradient.largest, is_exact ? 0 : 1e-3 * gradient.scale);

  // Adam moves a weight by the learning rate, whichever side of 0 its gradient lies: rounding may turn a few around.
  const Difference weights = difference_of(cpu.state, other.state, "network/", "");
  ASSERT_GT(weights.count, 1000);
  ::testing::Test::RecordProperty("weights_largest_difference", std::to_string(weights.largest));
  EXPECT_LE(weights.largest, is_exact ? 0 : 2.1e-3);
  EXPECT_LE(weights.mean, is_exact ? 0 : 1e-5);
}

TEST_P(DeviceParity, LogitsLossesGradientsAndOneStepAgreeWithTheCpu) {
  const torch::Device device = test::test_device();
  const Outcome cpu = train(GetParam(), torch::kCPU, 5), other = train(GetParam(), device, 5);
  expect_agreement(cpu, other, device.is_cpu());
}

TEST_P(DeviceParity, AGpusPathOnTheCpuAgreesWithTheCpusOwn) {
  const Outcome cpu = train(GetParam(), torch::kCPU, 5);
  const device::OperatorPath path;
  const Outcome operators = train(GetParam(), torch::kCPU, 5);
  EXPECT_GT(difference_of(cpu.state, operators.state, "optimizer/", ".exp_avg").largest, 0)
      << "sums in another order, or the path was not taken";
  expect_agreement(cpu, operators, false);
}

/// A GPU's second step is recorded and its third is a replay: weights after three of them, of batches that differ.
void expect_three_steps_agree(const Outcome& cpu, const Outcome& other, bool is_exact) {
  ASSERT_EQ(other.stats.optimizer_steps, cpu.stats.optimizer_steps);
  const Difference weights = difference_of(cpu.state, other.state, "network/", "");
  ASSERT_GT(weights.count, 1000);
  EXPECT_LE(weights.largest, is_exact ? 0 : 6.3e-3);  // three steps of the learning rate, to either side
  EXPECT_LE(weights.mean, is_exact ? 0 : 1e-4);
  const Difference gradient = difference_of(cpu.state, other.state, "optimizer/", ".exp_avg");
  EXPECT_LE(gradient.mean, is_exact ? 0 : 1e-2 * gradient.scale);
}

TEST_P(DeviceParity, ThreeStepsAgreeWithTheCpu) {
  const torch::Device device = test::test_device();
  const Outcome cpu = train(GetParam(), torch::kCPU, 5, 3), other = train(GetParam(), device, 5, 3);
  expect_three_steps_agree(cpu, other, device.is_cpu());
  const Outcome later = train(GetParam(), torch::kCPU, 6, 3);
  EXPECT_GT(difference_of(cpu.state, later.state, "network/", "").mean, 1e-4) << "other batches are seen";
}

TEST_P(DeviceParity, ThreeStepsOfAGpusPathOnTheCpuAgreeWithTheCpusOwn) {
  const Outcome cpu = train(GetParam(), torch::kCPU, 5, 3);
  const device::OperatorPath path;
  expect_three_steps_agree(cpu, train(GetParam(), torch::kCPU, 5, 3), false);
}

TEST_P(DeviceParity, AnotherBatchIsSeenInEachOfThem) {
  const Outcome one = train(GetParam(), torch::kCPU, 5), other = train(GetParam(), torch::kCPU, 6);
  EXPECT_GT((one.logits - other.logits).abs().max().item<double>(), 1e-4);
  const Difference gradient = difference_of(one.state, other.state, "optimizer/", ".exp_avg");
  EXPECT_GT(gradient.largest, 1e-3 * gradient.scale);
  EXPECT_GT(difference_of(one.state, other.state, "network/", "").mean, 1e-5);
}

INSTANTIATE_TEST_SUITE_P(Algorithms, DeviceParity,
                         ::testing::Values("ippo", "mappo", "happo", "idqn", "vdn", "qmix", "qplex_d",
                                           "qplex_q"),
                         [](const auto& algorithm) { return algorithm.param; });

}  // namespace device_parity_test
}  // namespace comrad::learn
