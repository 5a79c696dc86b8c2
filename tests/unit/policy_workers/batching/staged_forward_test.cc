#include "policy_workers/batching/staged_forward.h"

#include <gtest/gtest.h>

#include "policy_workers/device/torch_ops.h"
#include "tests/support/test_device.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::policy {
namespace staged_forward_test {

Batcher make_batcher(const shm::Arena& arena) {
  auto batcher = Batcher::create(arena, {.seed = 42});
  EXPECT_TRUE(batcher);
  return std::move(batcher).value();
}

double largest_difference(const Tensor& a, const Tensor& b) {
  return a.numel() == 0 ? 0 : (a - b).abs().max().item<double>();
}

/// The same weights on the CPU, whose plain pass is the reference, and on the device of the test.
struct Networks {
  ActorCritic on_cpu, on_device;
};

Networks make_networks(const NetworkOptions& options, uint64_t seed) {
  return {ActorCritic::create(options, seed, torch::kCPU),
          ActorCritic::create(options, seed, test::test_device())};
}

/// Answers what waits by `staged` and holds it to the CPU's plain pass over the same batch.
void answer_and_compare(Batcher& batcher, const ActorCritic& net, StagedForward& staged, size_t requests) {
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), requests);
  const PolicyOutput plain = net.step_rows(batch.frames, batch.measurement, batch.recurrent_state);
  const PolicyOutput output = staged.step(batch);
  ASSERT_EQ(output.logits.sizes(), plain.logits.sizes());
  ASSERT_EQ(output.recurrent_state.sizes(), plain.recurrent_state.sizes());
  const double bound = test::test_device().is_cpu() ? 1e-5 : 1e-4;
  EXPECT_LT(largest_difference(output.logits, plain.logits), bound);
  EXPECT_LT(largest_difference(output.value, plain.value), bound);
  EXPECT_LT(largest_difference(output.recurrent_state, plain.recurrent_state), bound);
  batcher.scatter(batch, output, 9);
}

TEST(StagedForward, BatchesAreRoundedUpToFewSizes) {
  std::vector<int64_t> sizes;
  for (int64_t worlds = 1; worlds <= 100; ++worlds) {
    const int64_t size = bucket_of(worlds);
    EXPECT_GE(size, worlds);
    EXPECT_LE(size, std::max<int64_t>(worlds, 3 * worlds / 2)) << worlds;
    if (sizes.empty() || sizes.back() != size) sizes.push_back(size);
  }
  EXPECT_EQ(sizes, (std::vector<int64_t>{1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128}));
}

class EveryStagedCore : public ::testing::TestWithParam<const char*> {};

TEST_P(EveryStagedCore, ComputesWhatThePlainPassComputesWhileStatesStayOnTheDevice) {
  const NetworkOptions options = small_network(GetParam());
  const bool has_state = options.recurrent_state_count() > 0;
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 10});
  const test::FullPrecision full;
  const auto [net, on_device] = make_networks(options, 3);
  Batcher batcher = make_batcher(arena);
  StagedForward staged(on_device, arena.shape());
  FakeSplit split(arena, 0, 0);
  ASSERT_EQ(split.envs.size(), 5u);  // a bucket of 6 has an idle world
  for (int step = 0; step < 3; ++step) {
    split.commit_act(/*reset_state=*/step == 0);
    answer_and_compare(batcher, net, staged, 5);
    split.take_act();
  }
  EXPECT_EQ(staged.states_brought_up(), 0) << "episodes began, then every state was there";

  // For a value request the network moves no state; then the same decision is requested.
  split.announce(2);
  for (int env : {1, 3}) split.envs[static_cast<size_t>(env)].commit_value();
  split.ring();
  answer_and_compare(batcher, net, staged, 2);
  for (int env : {1, 3}) split.envs[static_cast<size_t>(env)].take_other();
  split.commit_act();
  answer_and_compare(batcher, net, staged, 5);
  split.take_act();
  EXPECT_EQ(staged.states_brought_up(), 0);

  // A successor holds nothing: states come up from the arena, once.
  StagedForward successor(on_device, arena.shape());
  for (int step = 0; step < 2; ++step) {
    split.commit_act();
    answer_and_compare(batcher, net, successor, 5);
    split.take_act();
    EXPECT_EQ(successor.states_brought_up(), has_state ? 5 * 2 : 0);
  }
  // The first worker's states are old news by now.
  split.commit_act();
  answer_and_compare(batcher, net, staged, 5);
  EXPECT_EQ(staged.states_brought_up(), has_state ? 5 * 2 : 0);
}

TEST(StagedForward, PacksLargeBatchesWithSeveralThreads) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 120});
  const test::FullPrecision full;
  const auto [net, on_device] = make_networks(options, 3);
  Batcher batcher = make_batcher(arena);
  StagedForward staged(on_device, arena.shape(), /*packing_threads=*/3);
  FakeSplit split(arena, 0, 0);
  for (int step = 0; step < 3; ++step) {
    split.commit_act(/*reset_state=*/step == 0);
    answer_and_compare(batcher, net, staged, 60);
    split.take_act();
  }
}

INSTANTIATE_TEST_SUITE_P(Cores, EveryStagedCore, ::testing::Values("none", "gru", "lstm"),
                         [](const auto& of) { return of.param; });

class EveryPrecision : public ::testing::TestWithParam<Precision> {};

TEST_P(EveryPrecision, ReadsWeightsThatCameLater) {
  NetworkOptions options = small_network();
  options.precision = GetParam();
  const shm::Arena arena = make_arena(options, {});
  const test::FullPrecision full;
  const auto [net, on_device] = make_networks(options, 3);
  const ActorCritic other = ActorCritic::create(options, 4, torch::kCPU);
  Batcher batcher = make_batcher(arena);
  StagedForward staged(on_device, arena.shape());
  FakeSplit split(arena, 0, 0);
  const auto plain_pass = [&](const Batch& batch) {
    return net.step_rows(batch.frames, batch.measurement, batch.recurrent_state).logits.clone();
  };
  split.commit_act(true);
  {
    const Batch& batch = batcher.gather(0);
    batcher.scatter(batch, staged.step(batch), 9);
  }
  split.take_act();
  other.update_input_statistics(torch::full({4, 3, 40, 44}, 9, torch::kUInt8), torch::ones({4, 3}));
  const std::vector<std::byte> weights = other.weights();
  split.commit_act();
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), 2u);
  const Tensor old = plain_pass(batch);
  ASSERT_TRUE(net.read_weights(weights));
  ASSERT_TRUE(on_device.read_weights(weights));
  const Tensor expected = plain_pass(batch);
  const double change = largest_difference(expected, old);
  ASSERT_GT(change, 0.01);
  EXPECT_LT(largest_difference(staged.step(batch).logits, expected), change / 10);
}

INSTANTIATE_TEST_SUITE_P(Precisions, EveryPrecision, ::testing::Values(Precision::kFp32, Precision::kBf16),
                         [](const auto& of) { return of.param == Precision::kFp32 ? "fp32" : "bf16"; });

}  // namespace staged_forward_test
}  // namespace comrad::policy
