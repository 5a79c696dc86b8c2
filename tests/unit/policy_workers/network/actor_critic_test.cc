#include "policy_workers/network/actor_critic.h"

#include <gtest/gtest.h>

#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/cpu_features.h"
#include "tests/support/operator_count.h"

namespace comrad::policy {
namespace policy_net_test {

NetworkOptions full_options(const char* core, bool use_rnn = true) {
  NetworkOptions options;
  options.env.head_count = 5;
  options.env.head_sizes = {3, 3, 3, 2, 3};
  options.rnn_type = std::string_view(core) == "lstm" ? RnnType::kLstm : RnnType::kGru;
  options.use_rnn = use_rnn;
  return options;
}

NetworkOptions small_options(const char* core, bool use_rnn = true) {
  NetworkOptions options = full_options(core, use_rnn);
  options.env.height = 40;
  options.env.width = 44;
  options.env.measurement_count = 3;
  options.rnn_size = 24;
  return options;
}

Tensor random_frames(const NetworkOptions& options, at::IntArrayRef leading) {
  std::vector<int64_t> sizes(leading.begin(), leading.end());
  sizes.insert(sizes.end(), {options.env.channels, options.env.height, options.env.width});
  return torch::randint(0, 256, sizes, torch::kUInt8);
}

double largest_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

TEST(ActorCritic, HasTheParameterCountsOfTheSpecification) {
  NetworkOptions central = full_options("lstm");
  central.critic = CriticKind::kCentral;
  central.critic_view = CriticView::kPosition;
  EXPECT_EQ(ActorCritic::create(central, 1, torch::kCPU).parameter_count(), 4'058'096);
  EXPECT_EQ(ActorCritic::create(full_options("lstm"), 1, torch::kCPU).parameter_count(), 3'401'967);
  EXPECT_EQ(ActorCritic::create(full_options("gru"), 1, torch::kCPU).parameter_count(),
            1'293'024 + 1'575'936 + 512 * 14 + 14 + 512 + 1);
  EXPECT_EQ(ActorCritic::create(full_options("gru", false), 1, torch::kCPU).parameter_count(),
            1'293'024 + 512 * 14 + 14 + 512 + 1);
}

TEST(ActorCritic, TheSeedDecidesEveryWeight) {
  const ActorCritic first = ActorCritic::create(small_options("gru"), 1, torch::kCPU);
  torch::manual_seed(99);  // the global stream must not matter
  const ActorCritic again = ActorCritic::create(small_options("gru"), 1, torch::kCPU);
  const ActorCritic other = ActorCritic::create(small_options("gru"), 2, torch::kCPU);
  EXPECT_EQ(first.weights(), again.weights());
  EXPECT_NE(first.weights(), other.weights());
}

class EveryNet : public testing::TestWithParam<const char*> {
 protected:
  NetworkOptions options() const {
    return std::string(GetParam()) == "none" ? small_options("gru", false) : small_options(GetParam());
  }
};

TEST_P(EveryNet, SequenceEqualsRepeatedStepsWithResets) {
  const ActorCritic net = ActorCritic::create(options(), 3, torch::kCPU);
  const int64_t steps = 6, rows = 4, state_count = options().recurrent_state_count();
  const Tensor frame = random_frames(options(), {steps, rows}), measurement = torch::randn({steps, rows, 3});
  net.update_input_statistics(frame.flatten(0, 1), measurement.flatten(0, 1));
  const Tensor start = torch::randn({rows, state_count});
  const Tensor reset = torch::rand({steps, rows}).gt(0.6).to(torch::kUInt8);
  const SequenceOutput sequence = net.sequence(frame, measurement, start, reset);
  Tensor state = start;
  for (int64_t t = 0; t < steps; ++t) {
    state = state * reset[t].eq(0).to(torch::kFloat32).unsqueeze(-1);
    const PolicyOutput output = net.step(frame[t], measurement[t], state);
    EXPECT_LT(largest_difference(sequence.logits[t], output.logits), 1e-5) << "step " << t;
    EXPECT_LT(largest_difference(sequence.value[t], output.value), 1e-5) << "step " << t;
    state = output.recurrent_state;
  }
}

TEST_P(EveryNet, GradientsReachEveryParameter) {
  const ActorCritic net = ActorCritic::create(options(), 3, torch::kCPU);
  const Tensor frame = random_frames(options(), {4, 3}), measurement = torch::randn({4, 3, 3});
  const SequenceOutput output =
      net.sequence(frame, measurement, torch::zeros({3, options().recurrent_state_count()}), {});
  (output.logits.square().mean() + output.value.square().mean()).backward();
  for (auto& [name, tensor] : net.named_state()) {
    if (!tensor.requires_grad()) continue;
    ASSERT_TRUE(tensor.grad().defined()) << name;
    EXPECT_GT(tensor.grad().abs().sum().item<double>(), 0.0) << name;
    EXPECT_TRUE(torch::isfinite(tensor.grad()).all().item<bool>()) << name;
  }
}

// There the next layer takes a layer's bf16 result; what leaves the network is f32, as of a CPU's own kernels.
TEST_P(EveryNet, ADevicesOperatorsAgreeWithTheCpuInBf16) {
  if (!cpu_multiplies_bf16())
    GTEST_SKIP() << "this processor has no bf16 products, so factors are rounded back";
  NetworkOptions rounded = options();
  rounded.precision = Precision::kBf16;
  const ActorCritic net = ActorCritic::create(rounded, 3, torch::kCPU);
  const Tensor frame = random_frames(rounded, {4, 6}), measurement = torch::randn({4, 6, 3}),
               state = torch::randn({6, rounded.recurrent_state_count()});
  net.update_input_statistics(frame.flatten(0, 1), measurement.flatten(0, 1));
  struct Pass {
    std::vector<Tensor> outputs, gradients;
  };
  const auto pass = [&] {
    const PolicyOutput step = net.step(frame[0], measurement[0], state);
    const SequenceOutput sequence = net.sequence(frame, measurement, state, {});
    for (const Tensor& parameter : net.parameters()) parameter.mutable_grad() = Tensor();
    (sequence.logits.square().mean() + sequence.value.square().mean()).backward();
    Pass done = {.outputs = {step.logits, step.value, step.recurrent_state, sequence.logits, sequence.value,
                             net.encode(frame[0], measurement[0])},
                 .gradients = {}};
    for (const Tensor& parameter : net.parameters()) done.gradients.push_back(parameter.grad());
    return done;
  };
  const Pass own = pass();
  const device::OperatorPath as_on_a_device;
  const Pass operators = pass();
  for (std::size_t i = 0; i < own.outputs.size(); ++i) {
    EXPECT_EQ(operators.outputs[i].scalar_type(), torch::kFloat32) << i;
    EXPECT_LE((own.outputs[i] - operators.outputs[i]).norm().item<double>(),
              0.02 * own.outputs[i].norm().item<double>())
        << i;
  }
  for (std::size_t i = 0; i < own.gradients.size(); ++i) {
    const double size = own.gradients[i].norm().item<double>();
    EXPECT_EQ(operators.gradients[i].scalar_type(), torch::kFloat32) << i;
    EXPECT_LT((own.gradients[i] - operators.gradients[i]).norm().item<double>(), 0.05 * size) << i;
  }
}

TEST_P(EveryNet, OneAgentsFrameDoesNotReachAnotherAgentsOutputs) {
  const ActorCritic net = ActorCritic::create(options(), 3, torch::kCPU);
  const Tensor frame = random_frames(options(), {6}), measurement = torch::randn({6, 3});
  const Tensor state = torch::randn({6, options().recurrent_state_count()});
  const PolicyOutput before = net.step(frame, measurement, state);
  Tensor perturbed = frame.clone();
  perturbed[3] = 255 - perturbed[3];
  const PolicyOutput after = net.step(perturbed, measurement, state);
  for (int64_t row = 0; row < 6; ++row) {
    const bool same = torch::equal(before.logits[row], after.logits[row]) &&
                      torch::equal(before.value[row], after.value[row]) &&
                      torch::equal(before.recurrent_state[row], after.recurrent_state[row]);
    EXPECT_EQ(same, row != 3) << "row " << row;
  }
}

TEST_P(EveryNet, WeightsTravelAsBytesTogetherWithTheStatistics) {
  const ActorCritic learner = ActorCritic::create(options(), 3, torch::kCPU);
  const ActorCritic worker = ActorCritic::create(options(), 4, torch::kCPU);
  const Tensor frame = random_frames(options(), {5}), measurement = torch::randn({5, 3});
  learner.update_input_statistics(frame, measurement);
  ASSERT_TRUE(worker.read_weights(learner.weights()));
  EXPECT_EQ(worker.weights(), learner.weights());
  const Tensor state = torch::randn({5, options().recurrent_state_count()});
  EXPECT_TRUE(torch::equal(learner.step(frame, measurement, state).logits,
                           worker.step(frame, measurement, state).logits));
  for (const Tensor& parameter : worker.parameters())
    EXPECT_TRUE(parameter.requires_grad() && parameter.is_leaf());
}

// On a GPU that a learner shares, each wait is as long as the learner's turn.
TEST_P(EveryNet, WeightsAreTakenOverWithoutAWaitForTheDevice) {
  const ActorCritic learner = ActorCritic::create(options(), 3, torch::kCPU);
  const torch::Device device(torch::kCPU, 0);  // see HostWaitCounter
  const ActorCritic worker = ActorCritic::create(options(), 4, device);
  const std::vector<std::byte> weights = learner.weights();
  {
    const device::HostWaitCounter counter;
    ASSERT_TRUE(worker.read_weights(weights));
    EXPECT_EQ(counter.between_steps().all(), 0);
  }
  EXPECT_EQ(worker.weights(), weights);
  // Statistics continue from the count that came.
  learner.update_input_statistics(random_frames(options(), {5}), torch::randn({5, 3}));
  ASSERT_TRUE(worker.read_weights(learner.weights()));
  const Tensor frame = random_frames(options(), {4}), measurement = torch::randn({4, 3});
  learner.update_input_statistics(frame, measurement);
  worker.update_input_statistics(frame, measurement);
  EXPECT_EQ(worker.weights(), learner.weights());
}

// What a GPU is given by a forward pass of `small` for 64 agents; nine of the kernels are two there, the fused cell
// and a conversion, so 16 remain. More than half of the bytes are the frame's: normalised in f32, clipped into bf16.
TEST(ActorCritic, AForwardPassStartsFewKernelsAndMovesFewBytes) {
  if (!cpu_multiplies_bf16())
    GTEST_SKIP() << "this processor has no bf16 products, so factors are rounded back";
  NetworkOptions small;
  small.encoder = "impala";
  small.rnn_type = RnnType::kGru;
  small.rnn_size = 256;
  small.precision = Precision::kBf16;
  const ActorCritic net = ActorCritic::create(small, 3, torch::kCPU);
  constexpr int64_t kRows = 64;
  const Tensor frame = random_frames(small, {kRows}), state = torch::zeros({kRows, 256});
  const device::OperatorPath as_on_a_device;
  KeptFactors factors;
  const KeptFactors::Scope scope(factors);
  (void)net.step(frame, {}, state);  // rounds the weights
  const test::OperatorCount count;
  (void)net.step(frame, {}, state);
  EXPECT_LE(count.kernels(), 23);
  EXPECT_LE(count.bytes() / kRows, 573'000);
}

// What narrow_weights() of the link to other hosts takes for granted.
TEST_P(EveryNet, WeightsAreFloatsAndThenStatisticsInDoublePrecision) {
  const ActorCritic net = ActorCritic::create(options(), 3, torch::kCPU);
  const size_t parameters = net.named_parameters().size();
  const NamedTensors all = net.named_state();
  ASSERT_GT(all.size(), parameters);
  for (size_t i = 0; i < all.size(); ++i)
    EXPECT_EQ(all[i].second.scalar_type(), i < parameters ? torch::kFloat32 : torch::kFloat64)
        << all[i].first;
}

TEST_P(EveryNet, RefusesShortAndLongWeightsAndKeepsItsOwn) {
  const ActorCritic net = ActorCritic::create(options(), 3, torch::kCPU);
  const std::vector<std::byte> own = net.weights();
  std::vector<std::byte> bad(own.size() + 1);
  for (const size_t size : {size_t{0}, own.size() - 1, own.size() + 1}) {
    const Status read = net.read_weights(std::span(bad).first(size));
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::kBadFormat);
  }
  EXPECT_EQ(net.weights(), own);
}

TEST_P(EveryNet, FramesMayLieAnywhere) {
  const ActorCritic net = ActorCritic::create(options(), 3, torch::kCPU);
  const Tensor frame = random_frames(options(), {5}), measurement = torch::randn({5, 3});
  net.update_input_statistics(frame, measurement);
  const Tensor state = torch::randn({5, options().recurrent_state_count()});
  std::vector<Tensor> copies;
  std::vector<const uint8_t*> rows;
  for (int64_t row = 0; row < 5; ++row) {
    copies.push_back(frame[row].clone());
    rows.push_back(copies.back().data_ptr<uint8_t>());
  }
  const PolicyOutput dense = net.step(frame, measurement, state),
                     scattered = net.step_rows(rows, measurement, state);
  EXPECT_TRUE(torch::equal(dense.logits, scattered.logits));
  EXPECT_TRUE(torch::equal(dense.recurrent_state, scattered.recurrent_state));
}

INSTANTIATE_TEST_SUITE_P(ActorCritic, EveryNet, testing::Values("gru", "lstm", "none"));

TEST(ActorCritic, RescaledValuesAreTheSameLineOfTheOldOnes) {
  for (const CriticKind critic : {CriticKind::kOwn, CriticKind::kCentral, CriticKind::kJoint})
    for (const CriticView view : {CriticView::kOwnFirst, CriticView::kPosition}) {
      NetworkOptions options = small_options("gru");
      options.critic = critic;
      options.critic_view = view;
      options.separate_agents = critic == CriticKind::kJoint;
      const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
      const Tensor frame = random_frames(options, {4}), measurement = torch::randn({4, 3}),
                   state = torch::zeros({4, options.recurrent_state_count()});
      const PolicyOutput before = net.step(frame, measurement, state);
      net.rescale_values(0.25, -1.5);
      const PolicyOutput after = net.step(frame, measurement, state);
      EXPECT_LT(largest_difference(after.value, 0.25 * before.value - 1.5), 1e-5);
      EXPECT_TRUE(torch::equal(after.logits, before.logits));
    }
}

TEST(ActorCritic, AnOptimizerStepIsSeenByTheNextPass) {
  const NetworkOptions options = small_options("gru");
  const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
  const Tensor frame = random_frames(options, {2}), measurement = torch::randn({2, 3}),
               state = torch::zeros({2, 24});
  const Tensor before = net.step(frame, measurement, state).logits;
  for (Tensor& parameter : net.parameters()) {
    torch::NoGradGuard no_grad;
    parameter.add_(0.01);
  }
  EXPECT_FALSE(torch::equal(before, net.step(frame, measurement, state).logits));
}

TEST(ActorCritic, ChoosesDevicesByName) {
  EXPECT_TRUE(choose_device("cpu")->is_cpu());
  EXPECT_TRUE(choose_device("auto").has_value());
  for (const char* word : {"", "gpu", "cuda:", "cuda:x", "cuda:-1", "cuda:1x", "cud"}) {
    const auto device = choose_device(word);
    ASSERT_FALSE(device) << word;
    EXPECT_EQ(device.error().code, ErrorCode::kBadInput) << word;
  }
  EXPECT_FALSE(choose_device("cuda:120"));
}

}  // namespace policy_net_test
}  // namespace comrad::policy
