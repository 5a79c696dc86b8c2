#include "learner/step/part_statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "learner/algorithms/q_learning.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/noise_batch.h"

namespace comrad::learn {
namespace part_statistics_test {

std::map<std::string, double> numbers_of(const PartStatistics& parts) {
  NamedNumbers values;
  parts.append_to(values);
  return {values.begin(), values.end()};
}

TEST(PartStatistics, FindsThePartOfEveryParameterOfEveryNetwork) {
  std::map<std::string, std::vector<std::string>> parts_of;
  for (const char* algo : {"ippo", "mappo", "happo", "qmix"}) {
    RunConfig config = test::small_config(algo, 2);
    config.network.share_parameters = config.run.algo != "happo";
    config.mixers.mixer = config.run.algo == "qmix" ? "qmix" : "";
    config.network.decoder_mlp_layers = "8";
    config.network.q_layer_norm = true;  // of qmix alone
    const auto made = make_algorithm(config, test::small_shape(config, 2).env, torch::kCPU);
    ASSERT_TRUE(made) << made.error().message;
    StateDict state;
    (*made)->save(state);
    std::map<std::string, int> found;
    for (const auto& [key, value] : state.values())
      if (key.starts_with("network/") && !key.starts_with("network/normalizer"))
        ++found[part_of_parameter(key.substr(8))];
    for (const auto& [part, count] : found) parts_of[algo].push_back(part);
  }
  const std::vector<std::string> with_critic = {"core", "critic", "encoder", "heads"};
  EXPECT_EQ(parts_of["ippo"], with_critic);
  EXPECT_EQ(parts_of["mappo"], with_critic);
  EXPECT_EQ(parts_of["happo"], with_critic);
  EXPECT_EQ(parts_of["qmix"], (std::vector<std::string>{"core", "encoder", "heads"}));
  EXPECT_STREQ(part_of_parameter("encoder.conv1.weight"), "encoder");
  EXPECT_STREQ(part_of_parameter("agent1.core.weight_ih_l0"), "core");
  EXPECT_STREQ(part_of_parameter("core_norm.weight"), "core");
  EXPECT_STREQ(part_of_parameter("decoder.0.bias"), "heads");
  EXPECT_STREQ(part_of_parameter("agent1.decoder_norm.0.bias"), "heads");
  EXPECT_STREQ(part_of_parameter("agent0.action_head.weight"), "heads");
  EXPECT_STREQ(part_of_parameter("agent0.value_head.weight"), "critic");
  EXPECT_STREQ(part_of_parameter("critic.agent0.core.weight_ih_l0"), "critic");
  EXPECT_STREQ(part_of_parameter("critic.0.weight"), "critic");
}

TEST(PartStatistics, MatchThePlainFormulaAfterTwoSteps) {
  const double epsilon = 1e-2, beta2 = 0.9;
  const Tensor encoder = torch::zeros({3}).requires_grad_(), core = torch::zeros({2}).requires_grad_(),
               idle = torch::zeros({5}).requires_grad_();
  AdamOptimizer optimizer({encoder, core, idle}, {.beta2 = beta2, .epsilon = epsilon, .max_grad_norm = 0});
  const std::vector<std::vector<double>> gradients = {{1e-3, 0, 5}, {0.3, -4}};
  for (int step = 0; step < 2; ++step) {
    encoder.mutable_grad() = torch::tensor(gradients[0], torch::kFloat32);
    core.mutable_grad() = torch::tensor(gradients[1], torch::kFloat32);
    optimizer.step(1e-3);
  }
  PartStatistics parts;
  parts.add(optimizer,
            {{"encoder.conv1.weight", encoder}, {"core.bias_ih_l0", core}, {"action_head.bias", idle}});
  const auto numbers = numbers_of(parts);
  ASSERT_EQ(numbers.size(), 4u) << "nothing of a part without a step";
  EXPECT_NEAR(numbers.at("train/grad_norm_encoder"), std::hypot(1e-3, 5), 1e-4);
  EXPECT_NEAR(numbers.at("train/grad_norm_core"), std::hypot(0.3, 4), 1e-4);
  // A constant gradient: v_hat is its square, whatever beta2.
  for (const auto& [part, of_part] : {std::pair("encoder", gradients[0]), {"core", gradients[1]}}) {
    double gain = 0;
    for (const double g : of_part) gain += std::abs(g) / (std::abs(g) + epsilon);
    EXPECT_NEAR(numbers.at(std::string("train/adam_gain_") + part),
                gain / static_cast<double>(of_part.size()), 1e-5);
  }
}

TEST(PartStatistics, PartsOfSeveralOptimizersCountTogetherByTheirElements) {
  const Tensor small = torch::zeros({1}).requires_grad_(), large = torch::zeros({3}).requires_grad_();
  std::vector<AdamOptimizer> optimizers;
  for (const Tensor& parameter : {small, large})
    optimizers.emplace_back(std::vector<Tensor>{parameter}, AdamSettings{.epsilon = 1.0, .max_grad_norm = 0});
  small.mutable_grad() = torch::ones({1});
  large.mutable_grad() = torch::ones({3}) * 3;
  PartStatistics parts;
  for (AdamOptimizer& optimizer : optimizers) {
    optimizer.step(1e-3);
    parts.add(optimizer, {{"x", small}, {"y", large}}, "mixer");
  }
  const auto numbers = numbers_of(parts);
  EXPECT_NEAR(numbers.at("train/grad_norm_mixer"), std::sqrt(1.0 + 27.0), 1e-5);
  EXPECT_NEAR(numbers.at("train/adam_gain_mixer"), (0.5 + 3 * 0.75) / 4, 1e-5);
}

TEST(PartStatistics, EveryAlgorithmReportsItsParts) {
  for (const char* algo : {"ippo", "mappo", "happo"}) {
    RunConfig config = test::small_config(algo, 2);
    config.network.share_parameters = config.run.algo != "happo";
    const TrajectoryShape shape = test::small_shape(config, 2);
    const auto made = make_algorithm(config, shape.env, torch::kCPU);
    ASSERT_TRUE(made);
    NamedNumbers none;
    (*made)->append_diagnostics(none);
    EXPECT_TRUE(none.empty()) << "before the first step";
    RolloutBatch batch = test::noise_batch(shape, 4, 3);
    const auto stats = dynamic_cast<OnPolicyAlgorithm&>(**made).update(batch, {});
    ASSERT_TRUE(stats);
    NamedNumbers values;
    (*made)->append_diagnostics(values);
    EXPECT_EQ(values.size(), 8u) << algo;
    double squares = 0;
    for (const auto& [name, value] : values) {
      EXPECT_GT(value, 0) << algo << name;
      if (name.starts_with("train/grad_norm_")) squares += value * value;
      if (name.starts_with("train/adam_gain_")) {
        EXPECT_LT(value, 1) << algo << name;
      }
    }
    if (config.run.algo != "happo") {
      EXPECT_NEAR(std::sqrt(squares), test::values_of(*stats)["train/grad_norm"], 1e-4) << algo;
    }
  }
}

}  // namespace part_statistics_test
}  // namespace comrad::learn
