#include "policy_workers/network/core.h"

#include <gtest/gtest.h>

#include "policy_workers/device/torch_ops.h"
#include "tests/support/test_device.h"

namespace comrad::policy {
namespace core_test {

using CorePointer = std::shared_ptr<const Core>;

CorePointer core_of(const std::string& kind, int64_t input, int64_t hidden, int64_t layers,
                    torch::Device device = torch::kCPU) {
  torch::NoGradGuard no_grad;
  return make_core({.kind = kind, .input_count = input, .hidden_count = hidden, .layer_count = layers},
                   {.generator = at::make_generator<at::CPUGeneratorImpl>(5), .device = device});
}

void set(Tensor parameter, std::vector<float> values) {
  torch::NoGradGuard no_grad;
  parameter.copy_(torch::tensor(values).view_as(parameter));
}

double largest_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

struct Gradients {
  Tensor output, state, input;
  std::vector<Tensor> parameters;
};

/// Runs T steps and backpropagates a random weighting of all outputs.
template <typename Run>
Gradients gradients_of(const Core& core, const Tensor& input, const Tensor& state, Run&& run) {
  const Tensor x = input.clone().requires_grad_(), s = state.clone().requires_grad_();
  for (auto& [name, parameter] : core.named_parameters())
    if (parameter.grad().defined()) parameter.mutable_grad().zero_();
  const Tensor output = run(x, s);
  const Tensor weights =
      torch::linspace(-1, 1, output.numel(), output.options().requires_grad(false)).view_as(output);
  (output * weights).sum().backward();
  Gradients result{output.detach(), s.grad().clone(), x.grad().clone(), {}};
  for (auto& [name, parameter] : core.named_parameters())
    result.parameters.push_back(parameter.grad().clone());
  return result;
}

/// The plain way: one step after the other, state zeroed by hand, autograd through the framework's cells.
Tensor unrolled(const Core& core, const Tensor& input, Tensor state, const Tensor& keep) {
  std::vector<Tensor> outputs;
  for (int64_t t = 0; t < input.size(0); ++t) {
    if (keep.defined()) state = state * keep[t];
    const CoreOutput after = core.step(input[t], state);
    outputs.push_back(after.features);
    state = after.state;
  }
  return torch::stack(outputs);
}

TEST(Core, GruMatchesTheKnownAnswer) {
  const CorePointer core = core_of("gru", 1, 1, 1);
  const NamedTensors weights = core->named_parameters();
  set(weights[0].second, {0.5f, 0.2f, 1.0f});
  set(weights[1].second, {-0.3f, 0.4f, 0.6f});
  set(weights[2].second, {0.1f, 0.0f, 0.05f});
  set(weights[3].second, {0.0f, -0.1f, 0.02f});
  const Tensor x = torch::full({1, 1}, 0.7), h = torch::full({1, 1}, 0.2);
  EXPECT_NEAR(core->step(x, h).features.item<float>(), 0.426717, 1e-6);
  EXPECT_NEAR(core->sequence(x.unsqueeze(0), h, {}).features.item<float>(), 0.426717, 1e-6);
}

TEST(Core, LstmMatchesTheKnownAnswer) {
  const CorePointer core = core_of("lstm", 1, 1, 1);
  const NamedTensors weights = core->named_parameters();
  set(weights[0].second, {0.5f, 0.2f, 1.0f, -0.7f});
  set(weights[1].second, {-0.3f, 0.4f, 0.6f, 0.3f});
  set(weights[2].second, {0.1f, 1.0f, 0.05f, 0.2f});
  set(weights[3].second, {0.0f, 0.0f, 0.0f, 0.0f});
  const Tensor x = torch::full({1, 1}, 0.7), state = torch::tensor({{0.2f, -0.4f}});  // h, then c
  for (const Tensor& after : {core->step(x, state).state, core->sequence(x.unsqueeze(0), state, {}).state}) {
    EXPECT_NEAR(after[0][0].item<float>(), 0.048241, 1e-6);
    EXPECT_NEAR(after[0][1].item<float>(), 0.109392, 1e-6);
  }
}

TEST(Core, StateHoldsEveryLayersHAndThenEveryLayersC) {
  EXPECT_EQ(core_of("gru", 4, 6, 2)->state_count(), 12);
  EXPECT_EQ(core_state_count({.kind = "lstm", .hidden_count = 6, .layer_count = 2}), 24);
  EXPECT_EQ(core_of("lstm", 4, 6, 2)->state_count(), 24);
  EXPECT_EQ(core_of("none", 4, 6, 2)->state_count(), 0);
  const CorePointer core = core_of("lstm", 4, 6, 2);
  torch::NoGradGuard no_grad;
  const CoreOutput after = core->step(torch::randn({3, 4}), torch::randn({3, 24}));
  EXPECT_EQ(largest_difference(after.state.slice(1, 6, 12), after.features), 0.0) << "h of the last layer";
  EXPECT_GT(largest_difference(after.state.slice(1, 18, 24).tanh(), after.features), 0.0);
}

/// On the device of the test: a GPU has its own sequence, while steps are the framework's cells.
class EveryCore : public ::testing::TestWithParam<std::pair<const char*, int64_t>> {
 protected:
  CorePointer core() const { return core_of(GetParam().first, 7, 9, GetParam().second, device_); }
  /// What may lie between sums in another order.
  double bound(double on_cpu) const { return device_.is_cpu() ? on_cpu : 10 * on_cpu; }

  const torch::Device device_ = comrad::test::test_device();
  const torch::TensorOptions options_ = torch::TensorOptions().device(device_);

 private:
  const comrad::test::FullPrecision full_;
};

TEST_P(EveryCore, SequenceEqualsRepeatedStepsWithResets) {
  const CorePointer core = this->core();
  const Tensor input = torch::randn({12, 5, 7}, options_),
               state = torch::randn({5, core->state_count()}, options_);
  const Tensor keep = torch::rand({12, 5, 1}, options_).gt(0.3).to(torch::kFloat32);
  ASSERT_LT(keep.sum().item<float>(), 60.0f);
  EXPECT_LT(
      largest_difference(core->sequence(input, state, keep).features, unrolled(*core, input, state, keep)),
      bound(1e-6));
  EXPECT_LT(largest_difference(core->sequence(input, state, {}).features, unrolled(*core, input, state, {})),
            bound(1e-6));
}

TEST_P(EveryCore, SequenceHasTheGradientsOfRepeatedSteps) {
  const CorePointer core = this->core();
  const Tensor input = torch::randn({10, 4, 7}, options_),
               state = torch::randn({4, core->state_count()}, options_);
  const Tensor keep = torch::rand({10, 4, 1}, options_).gt(0.25).to(torch::kFloat32);
  const Gradients fused = gradients_of(*core, input, state, [&](const Tensor& x, const Tensor& s) {
    return core->sequence(x, s, keep).features;
  });
  const Gradients plain = gradients_of(
      *core, input, state, [&](const Tensor& x, const Tensor& s) { return unrolled(*core, x, s, keep); });
  EXPECT_LT(largest_difference(fused.input, plain.input), bound(1e-5));
  EXPECT_LT(largest_difference(fused.state, plain.state), bound(1e-5));
  for (size_t index = 0; index < fused.parameters.size(); ++index)
    EXPECT_LT(largest_difference(fused.parameters[index], plain.parameters[index]), bound(2e-5))
        << core->named_parameters()[index].first;
}

TEST_P(EveryCore, AResetInsideEqualsTwoSeparateRollouts) {
  const CorePointer core = this->core();
  const Tensor input = torch::randn({8, 3, 7}, options_),
               state = torch::randn({3, core->state_count()}, options_);
  Tensor keep = torch::ones({8, 3, 1}, options_);
  keep[5].zero_();
  const Gradients whole = gradients_of(*core, input, state, [&](const Tensor& x, const Tensor& s) {
    return core->sequence(x, s, keep).features;
  });
  const Gradients two = gradients_of(*core, input, state, [&](const Tensor& x, const Tensor& s) {
    const Tensor first = core->sequence(x.slice(0, 0, 5), s, {}).features;
    const Tensor second = core->sequence(x.slice(0, 5), torch::zeros_like(s), {}).features;
    return torch::cat({first, second});
  });
  EXPECT_LT(largest_difference(whole.output, two.output), bound(1e-6));
  EXPECT_LT(largest_difference(whole.input, two.input), bound(1e-5));
  for (size_t index = 0; index < whole.parameters.size(); ++index)
    EXPECT_LT(largest_difference(whole.parameters[index], two.parameters[index]), bound(2e-5));
}

INSTANTIATE_TEST_SUITE_P(Core, EveryCore,
                         ::testing::Values(std::pair<const char*, int64_t>{"gru", int64_t{1}},
                                           std::pair<const char*, int64_t>{"gru", int64_t{2}},
                                           std::pair<const char*, int64_t>{"lstm", int64_t{1}},
                                           std::pair<const char*, int64_t>{"lstm", int64_t{2}}));

TEST(Core, WithoutACoreFeaturesPassUnchanged) {
  const CorePointer core = core_of("none", 7, 9, 1);
  const Tensor input = torch::randn({3, 7});
  EXPECT_TRUE(torch::equal(core->step(input, torch::zeros({3, 0})).features, input));
  EXPECT_EQ(core->feature_count(), 7);
}

}  // namespace core_test
}  // namespace comrad::policy
