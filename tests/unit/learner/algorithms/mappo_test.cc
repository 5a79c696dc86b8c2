#include "learner/algorithms/mappo.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "tests/support/noise_batch.h"

namespace comrad::learn {
namespace mappo_test {

using test::gradients;

constexpr int kAgents = 3;

RunConfig small_config() { return test::small_config("mappo", kAgents); }
TrajectoryShape small_shape(const RunConfig& config) { return test::small_shape(config, kAgents); }

RolloutBatch noise_batch(const TrajectoryShape& shape, int slab_count, uint64_t seed) {
  RolloutBatch batch = test::noise_batch(shape, slab_count, seed);
  apply_lag_filter(batch, 0, 1000);
  return batch;
}

policy::SequenceOutput run(const Mappo& mappo, const RolloutBatch& batch) {
  torch::NoGradGuard no_grad;
  return mappo.net().sequence(batch.frame, batch.measurement, batch.recurrent_state, batch.reset);
}

TEST(Mappo, TheCriticSeesAllAgentsOfTheSameStepAndNoOthers) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  const Mappo mappo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 3, 1);
  const Tensor before = run(mappo, batch).value;
  // Another frame for agent 1 of world 1 in the last step.
  const int64_t agents = 3, world = 1, last = batch.steps() - 1;
  batch.frame[last][world * agents + 1] = 255 - batch.frame[last][world * agents + 1];
  const Tensor after = run(mappo, batch).value;
  for (int64_t step = 0; step < batch.steps(); ++step)
    for (int64_t row = 0; row < batch.rows(); ++row) {
      const bool changed = before[step][row].item<float>() != after[step][row].item<float>();
      EXPECT_EQ(changed, step == last && row / agents == world) << "step " << step << " row " << row;
    }
}

TEST(Mappo, GivesEachAgentASeparateValue) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  const Mappo mappo(config, shape.env, torch::kCPU);
  const Tensor value = run(mappo, noise_batch(shape, 1, 2)).value;
  EXPECT_NE(value[0][0].item<float>(), value[0][1].item<float>());
  EXPECT_NE(value[0][1].item<float>(), value[0][2].item<float>());
}

TEST(Mappo, TheOrderOfWorldsInABatchChangesNeitherValuesNorGradient) {
  RunConfig config = small_config();
  config.optimisation.micro_batch_size = 12;  // a world at a time
  const TrajectoryShape shape = small_shape(config);
  Mappo mappo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 3);
  mappo.prepare_targets(batch);
  const std::vector<int64_t> order = {2, 0, 3, 1};
  RolloutBatch shuffled = select_slabs(batch, order);
  const Tensor value = run(mappo, batch).value, other = run(mappo, shuffled).value;
  for (std::size_t place = 0; place < order.size(); ++place)
    for (int64_t agent = 0; agent < 3; ++agent)
      EXPECT_TRUE(torch::allclose(value.select(1, order[place] * 3 + agent),
                                  other.select(1, static_cast<int64_t>(place) * 3 + agent), 1e-5, 1e-6));

  TermValues terms, shuffled_terms;
  ASSERT_TRUE(mappo.accumulate_gradient(batch, {}, terms));
  const std::vector<Tensor> gradient = gradients(mappo.net());
  ASSERT_TRUE(mappo.accumulate_gradient(shuffled, {}, shuffled_terms));
  const std::vector<Tensor> shuffled_gradient = gradients(mappo.net());
  EXPECT_NEAR(terms["value_loss"], shuffled_terms["value_loss"], 1e-5);
  for (std::size_t i = 0; i < gradient.size(); ++i)
    EXPECT_TRUE(torch::allclose(gradient[i], shuffled_gradient[i], 1e-3, 1e-6)) << i;
}

TEST(Mappo, TrainingSeesTheValuesOfSampling) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  const Mappo mappo(config, shape.env, torch::kCPU);
  const RolloutBatch batch = noise_batch(shape, 2, 4);
  const Tensor sequence = run(mappo, batch).value;
  torch::NoGradGuard no_grad;
  Tensor state = batch.recurrent_state.clone();
  for (int64_t step = 0; step < batch.steps(); ++step) {
    const Tensor keep = batch.reset[step].eq(0).to(torch::kFloat32).unsqueeze(1);
    const policy::PolicyOutput output = mappo.net().step(batch.frame[step], {}, state * keep);
    state = output.recurrent_state;
    EXPECT_TRUE(torch::allclose(output.value, sequence[step], 1e-4, 1e-5)) << step;
  }
}

TEST(Mappo, TheValueGradientReachesTheEncoder) {
  RunConfig config = small_config();
  config.on_policy.exploration_loss_coeff = 0;
  const TrajectoryShape shape = small_shape(config);
  Mappo mappo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 2, 5);
  mappo.prepare_targets(batch);
  batch.advantage.zero_();
  TermValues terms;
  ASSERT_TRUE(mappo.accumulate_gradient(batch, {}, terms));
  EXPECT_GT(gradients(mappo.net()).front().abs().max().item<double>(), 0);
}

TEST(Mappo, ACheckpointOfTheOtherViewIsRefusedAndTheSettingNamed) {
  RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Mappo own_first(config, shape.env, torch::kCPU);
  config.network.mappo_critic_view = CriticView::kPosition;
  const Mappo position(config, shape.env, torch::kCPU);
  StateDict state;
  position.save(state);
  const Status loaded = own_first.load(state);
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::kBadFormat);
  EXPECT_NE(loaded.error().message.find("mappo_critic_view = \"position\""), std::string::npos)
      << loaded.error().message;
}

TEST(Mappo, ACheckpointOfIppoIsRefused) {
  RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Mappo mappo(config, shape.env, torch::kCPU);
  config.run.algo = "ippo";
  const Ippo ippo(config, shape.env, torch::kCPU);
  StateDict state;
  ippo.save(state);
  const Status loaded = mappo.load(state);
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::kBadFormat);
}

}  // namespace mappo_test
}  // namespace comrad::learn
