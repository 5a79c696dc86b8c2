// An optimizer step reads nothing from the device: whatever would make the host wait for a GPU is counted on the CPU, for
// every algorithm.
#include "policy_workers/device/host_wait_counter.h"

#include <gtest/gtest.h>

#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/ippo.h"
#include "learner/algorithms/q_learning.h"
#include "policy_workers/device/readback.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/replay/replay.h"
#include "tests/support/noise_batch.h"
#include "tests/support/slab_pool.h"

namespace comrad::learn {
namespace host_waits_test {

constexpr int kAgents = 2, kWorlds = 4;

RunConfig config_of(const std::string& algo) {
  RunConfig config = test::small_config(algo, kAgents);
  config.network.normalize_input = true;
  config.network.share_parameters = algo != "happo";
  config.on_policy.kl_loss_coeff = 0.1;
  config.q_learning.normalize_q_values = true;
  config.optimisation.micro_batch_size = 2 * kAgents * 5;  // two micro-batches
  config.collection.learner_threads = 2;
  if (algo == "vdn" || algo == "qmix") config.mixers.mixer = algo;
  if (algo == "qplex_d") config.mixers.mixer = "dmaq";
  if (algo == "qplex_q") config.mixers.mixer = "dmaq_qatten";
  return config;
}

ReplayBatch sequences(const TrajectoryShape& shape, uint64_t seed) {
  test::SlabPool pool(shape, kWorlds);
  pool.fill_with_noise(seed);
  pool.view(0).truncated(2) = 1;
  pool.view(0).final_index(2) = 0;
  pool.view(1).action_mask(1, 0)[1] = 0;
  auto replay = *replay::Replay::create({.store = {.shape = shape, .capacity_bytes = 1 << 24}});
  std::vector<replay::Draw> draws;
  for (int i = 0; i < kWorlds; ++i) {
    replay->insert(pool.view(i), static_cast<uint32_t>(shape.rollout_steps));
    draws.push_back({.item = i, .step = -1, .agent = 0, .weight = 1, .serial = i});
  }
  const ReplayBatchOptions options{.shape = shape, .world_count = kWorlds};
  ReplayBatch batch = make_replay_batch(options);
  fill(batch, options, *replay, draws);
  return batch;
}

/// An update, with "cpu:0" for a device: see HostWaitCounter.
UpdateStats update(Algorithm& algorithm, const TrajectoryShape& shape, uint64_t seed, bool reports = true,
                   bool is_broken = false) {
  UpdateContext context;
  context.reports = reports;
  if (auto* on_policy = dynamic_cast<OnPolicyAlgorithm*>(&algorithm)) {
    RolloutBatch batch = test::noise_batch(shape, kWorlds, seed);
    batch.valid[1][2] = 0;
    batch.agent_active[2][1] = 0;
    if (is_broken) batch.recurrent_state.fill_(std::numeric_limits<float>::quiet_NaN());
    return *on_policy->update(batch, context);
  }
  ReplayBatch batch = sequences(shape, seed);
  if (is_broken) batch.recurrent_state.fill_(std::numeric_limits<float>::quiet_NaN());
  return *dynamic_cast<OffPolicyAlgorithm&>(algorithm).update(batch, context);
}

class HostWaits : public ::testing::TestWithParam<std::string> {};

TEST_P(HostWaits, NoStepMakesTheHostWaitForTheDevice) {
  for (const Precision precision : {Precision::kFp32, Precision::kBf16}) {
    RunConfig config = config_of(GetParam());
    config.collection.precision = precision;
    config.optimisation.num_batches_per_epoch = config.run.algo->learns_q_values() ? 1 : 2;
    const TrajectoryShape shape = test::small_shape(config, kAgents);
    const auto algorithm = *make_algorithm(config, shape.env, torch::Device(torch::kCPU, 0));
    (void)update(*algorithm, shape, 1);  // what is made once is made
    const device::HostWaitCounter counter;
    const UpdateStats stats = update(*algorithm, shape, 2);
    ASSERT_GE(stats.optimizer_steps, 1);
    const auto inside = counter.in_steps();
    EXPECT_EQ(inside.numbers_read, 0);
    EXPECT_EQ(inside.nonzero, 0);
    EXPECT_EQ(inside.device_copies, 0) << (precision == Precision::kBf16 ? "bf16" : "fp32");
    EXPECT_EQ(inside.readbacks, 0);
    // Once a batch: the report's numbers, and, of steps that a GPU still had in its queue, theirs.
    EXPECT_LE(counter.between_steps().all(), 2);
  }
}

TEST_P(HostWaits, StepsThatAreReadLateGiveTheSameWeights) {
  RunConfig config = config_of(GetParam());
  config.optimisation.num_batches_per_epoch = config.run.algo->learns_q_values() ? 1 : 2;
  config.optimisation.num_epochs = 2;
  const TrajectoryShape shape = test::small_shape(config, kAgents);
  const auto weights_after = [&](bool late) {
    std::optional<device::SlowReadbacks> slow;
    if (late) slow.emplace();
    const auto algorithm = *make_algorithm(config, shape.env, torch::kCPU);
    NamedNumbers said;
    for (uint64_t seed = 1; seed <= 2; ++seed) said = update(*algorithm, shape, seed).values;
    return std::tuple(algorithm->weights(), algorithm->version(), said);
  };
  EXPECT_EQ(weights_after(true), weights_after(false));
}

/// Priorities and the first units of normalize_q_values follow from what became of a step, so they wait.
RunConfig config_that_waits_for_nothing(const std::string& algo) {
  RunConfig config = config_of(algo);
  config.optimisation.num_batches_per_epoch = config.run.algo->learns_q_values() ? 1 : 2;
  config.q_learning.normalize_q_values = false;
  config.replay.per = false;
  return config;
}

TEST_P(HostWaits, AnUpdateThatReportsNothingWaitsForNothing) {
  const RunConfig config = config_that_waits_for_nothing(GetParam());
  const TrajectoryShape shape = test::small_shape(config, kAgents);
  const auto weights_after = [&](bool reports) {
    const auto algorithm = *make_algorithm(config, shape.env, torch::Device(torch::kCPU, 0));
    (void)update(*algorithm, shape, 1);
    const device::SlowReadbacks slow;
    {
      const device::HostWaitCounter counter;
      for (uint64_t seed = 2; seed <= 4; ++seed) {
        const UpdateStats stats = update(*algorithm, shape, seed, reports);
        EXPECT_EQ(stats.values.empty(), !reports);
      }
      const int64_t waits = counter.in_steps().all() + counter.between_steps().all();
      EXPECT_TRUE(reports ? waits > 0 : waits == 0) << waits;
    }
    const NamedNumbers said = update(*algorithm, shape, 5).values;
    return std::tuple(algorithm->weights(), algorithm->version(), said);
  };
  EXPECT_EQ(weights_after(false), weights_after(true));
}

INSTANTIATE_TEST_SUITE_P(AllAlgorithms, HostWaits,
                         ::testing::Values("ippo", "mappo", "happo", "idqn", "vdn", "qmix", "qplex_d",
                                           "qplex_q"),
                         [](const auto& of) { return of.param; });

TEST(QScale, MovesAtTheSameUpdatesWhereStepsAreReadLate) {
  const RunConfig config = config_of("vdn");
  const TrajectoryShape shape = test::small_shape(config, kAgents);
  const auto after = [&](bool late) {
    std::optional<device::SlowReadbacks> slow;
    if (late) slow.emplace();
    const auto algorithm = *make_algorithm(config, shape.env, torch::kCPU);
    std::vector<double> units;
    ReplayBatch batch = sequences(shape, 5);
    UpdateContext context;
    for (int i = 1; i <= 130; ++i) {
      context.reports = i % 50 == 0;  // when that is must not matter
      batch.abs_td = Tensor();
      EXPECT_TRUE(algorithm->off_policy()->update(batch, context));
      units.push_back(dynamic_cast<const QLearning&>(*algorithm).q_sigma());
    }
    return std::pair(units, algorithm->weights());
  };
  const auto [units, weights] = after(false);
  EXPECT_EQ(after(true), std::pair(units, weights));
  for (std::size_t update = 2; update <= units.size(); ++update)
    EXPECT_EQ(units[update - 1] != units[update - 2], update <= 62 || update % 64 == 0)
        << "update " << update;
}

TEST(StepGuard, AStepThatIsReadLateAndWasNotTakenIsTakenBack) {
  const RunConfig config = config_of("ippo");
  const TrajectoryShape shape = test::small_shape(config, kAgents);
  Ippo ippo(config, shape.env, torch::kCPU);
  const device::SlowReadbacks late;
  RolloutBatch batch = test::noise_batch(shape, kWorlds, 3);
  batch.recurrent_state.fill_(std::numeric_limits<float>::quiet_NaN());
  const auto before = test::copies(ippo.net().parameters());
  const auto stats = ippo.update(batch, {});
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->optimizer_steps, 0);
  EXPECT_EQ(stats->skipped_steps, 1);
  EXPECT_EQ(ippo.version(), 0u);
  EXPECT_TRUE(test::all_equal(before, ippo.net().parameters()));
}

TEST(StepGuard, AStepThatIsReadInALaterUpdateAndWasNotTakenIsTakenBackThere) {
  for (const char* const name : {"ippo", "qmix"})
    for (const bool settles : {false, true}) {
      RunConfig config = config_that_waits_for_nothing(name);
      config.optimisation.num_batches_per_epoch = 1;
      const TrajectoryShape shape = test::small_shape(config, kAgents);
      const auto algorithm = *make_algorithm(config, shape.env, torch::kCPU);
      const device::SlowReadbacks late;
      EXPECT_EQ(update(*algorithm, shape, 3, /*reports=*/false, /*is_broken=*/true).skipped_steps, 0);
      EXPECT_EQ(algorithm->version(), 1u) << "nothing is known yet";
      if (settles) {
        algorithm->settle();
        EXPECT_EQ(algorithm->version(), 0u);
      }
      const UpdateStats stats = update(*algorithm, shape, 4);
      EXPECT_EQ(stats.optimizer_steps, 1);
      EXPECT_EQ(stats.skipped_steps, 1);
      EXPECT_EQ(algorithm->version(), 1u);
    }
}

TEST(HostWaitCounter, SeesEachKindInsideAndOutsideOfSteps) {
  const device::HostWaitCounter counter;
  const Tensor numbers = torch::ones({3}, torch::kFloat64);
  const auto wait = [&] {
    (void)numbers.sum().item<double>();
    (void)numbers.nonzero();
    (void)torch::equal(numbers, numbers);
    (void)numbers.cpu();
    (void)numbers.to(torch::Device(torch::kCPU, 0));                                  // to the device at work
    (void)numbers.to(numbers.options().device(torch::kCPU).dtype(torch::kBFloat16));  // a rounding
    device::Readback(numbers).wait();
  };
  wait();
  EXPECT_EQ(counter.in_steps().all(), 0);
  EXPECT_EQ(counter.between_steps().numbers_read, 2);
  EXPECT_EQ(counter.between_steps().nonzero, 1);
  EXPECT_EQ(counter.between_steps().device_copies, 1);
  EXPECT_EQ(counter.between_steps().readbacks, 1);
  const device::StepScope step;
  wait();
  EXPECT_EQ(counter.in_steps().all(), 5);
}

}  // namespace host_waits_test
}  // namespace comrad::learn
