#include "learner/algorithms/ippo.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "rollout_buffer/core/cpu_features.h"
#include "rollout_buffer/core/rng.h"
#include "tests/support/noise_batch.h"
#include "tests/support/operator_count.h"
#include "tests/support/slab_pool.h"

namespace comrad::learn {
namespace ippo_test {

using test::all_equal;
using test::copies;
using test::gradients;
using test::noise_batch;
using test::SlabPool;
using test::values_of;

constexpr int kAgents = 2;

RunConfig small_config() { return test::small_config("ippo", kAgents); }
TrajectoryShape small_shape(const RunConfig& config) { return test::small_shape(config, kAgents); }

/// Makes the network itself the behaviour policy of the batch.
void act_with(const policy::ActorCritic& net, RolloutBatch& batch) {
  torch::NoGradGuard no_grad;
  apply_lag_filter(batch, 0, 1000);
  const policy::SequenceOutput output =
      net.sequence(batch.frame, batch.measurement, batch.recurrent_state, batch.reset);
  const Tensor log_probs = policy::head_log_probs(output.logits, batch.mask_or_undefined(), batch.shape.env);
  batch.logits.copy_(output.logits);
  batch.log_prob.copy_(policy::action_log_prob(log_probs, batch.action, batch.shape.env));
  batch.value.narrow(0, 0, batch.steps()).copy_(output.value);
}

double largest_relative_difference(const std::vector<Tensor>& a, const std::vector<Tensor>& b) {
  double difference = 0, scale = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference = std::max(difference, (a[i] - b[i]).abs().max().item<double>());
    scale = std::max(scale, a[i].abs().max().item<double>());
  }
  return difference / scale;
}

TEST(Ippo, TheFirstUpdateOfFreshDataHasRatioOneAndClipsNothing) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 1);
  act_with(ippo.net(), batch);
  const Expected<UpdateStats> stats = ippo.update(batch, {});
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->optimizer_steps, 1);
  EXPECT_EQ(stats->rows_trained, 32);
  EXPECT_EQ(ippo.version(), 1u);
  auto values = values_of(*stats);
  EXPECT_NEAR(values["train/ratio_min"], 1, 1e-5);
  EXPECT_NEAR(values["train/ratio_max"], 1, 1e-5);
  EXPECT_EQ(values["train/fraction_clipped"], 0);
  EXPECT_NEAR(values["train/kl_divergence"], 0, 1e-6);
  EXPECT_NEAR(values["train/value_delta_max"], 0, 1e-5);
}

TEST(Ippo, TrainingRepeatsTheLogProbOfSamplingWithMasksAndResets) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  const SlabPool pool(shape, 1);
  pool.fill_with_noise(2);
  const SlabView slab = pool.view(0);
  slab.action_mask(1, 0)[2] = 0;
  slab.action_mask(2, 1)[0] = slab.action_mask(2, 1)[4] = 0;
  slab.terminated(1) = 1;
  // Collect as a policy worker does: one step at a time.
  torch::NoGradGuard no_grad;
  Tensor state = torch::zeros({2, shape.recurrent_state_count});
  for (int agent = 0; agent < 2; ++agent) {
    const auto start = slab.recurrent_state(0, agent);
    std::copy(start.begin(), start.end(), state.data_ptr<float>() + agent * shape.recurrent_state_count);
  }
  for (int t = 0; t < shape.rollout_steps; ++t) {
    const Tensor frame = torch::from_blob(slab.frames(t).data(), {2, 3, 36, 36}, torch::kUInt8).clone();
    const policy::PolicyOutput output = ippo.net().step(frame, {}, state);
    state = output.recurrent_state.clone();
    if (slab.terminated(t) != 0) state.zero_();
    for (int agent = 0; agent < 2; ++agent) {
      const Tensor logits = output.logits[agent].contiguous();
      const std::span<const float> row(logits.data_ptr<float>(), 5);
      std::copy(row.begin(), row.end(), slab.logits(t, agent).begin());
      slab.log_prob(t, agent) =
          policy::sample_action(row, slab.action_mask(t, agent), shape.env,
                                RngKey(5).split(static_cast<uint64_t>(t)).split(static_cast<uint64_t>(agent)),
                                false, slab.action(t, agent));
      for (int head = 0, offset = 0; head < 2;
           offset += shape.env.head_sizes[static_cast<std::size_t>(head++)])
        EXPECT_EQ(slab.action_mask(t, agent)[static_cast<std::size_t>(
                      offset + slab.action(t, agent)[static_cast<std::size_t>(head)])],
                  1);
      slab.value(t, agent) = output.value[agent].item<float>();
    }
  }
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  ASSERT_EQ(collate_slab(batch, 0, slab, 4), 0);
  ASSERT_TRUE(batch.has_action_mask);
  torch::AutoGradMode with_gradient(true);
  const Expected<UpdateStats> stats = ippo.update(batch, {});
  ASSERT_TRUE(stats);
  auto values = values_of(*stats);
  EXPECT_NEAR(values["train/ratio_min"], 1, 1e-4);
  EXPECT_NEAR(values["train/ratio_max"], 1, 1e-4);
  EXPECT_NEAR(values["train/kl_divergence_max"], 0, 1e-5);
  EXPECT_NEAR(values["train/value_delta_max"], 0, 1e-4);
}

TEST(Ippo, MicroBatchesGiveTheGradientOfTheWholeBatch) {
  std::vector<std::vector<Tensor>> results;
  for (const int64_t micro_batch_size : {4096, 16, 8, 1}) {
    RunConfig config = small_config();
    config.optimisation.micro_batch_size = micro_batch_size;
    config.on_policy.kl_loss_coeff = 0.1;
    const TrajectoryShape shape = small_shape(config);
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 5, 3);
    batch.policy_version[2][3] = -5000;  // one sample too old, so that the valid counts differ
    batch.terminated[1][2] = 1;
    apply_lag_filter(batch, 0, 1000);
    ippo.prepare_targets(batch);
    TermValues terms;
    ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms));
    results.push_back(gradients(ippo.net()));
  }
  for (std::size_t i = 1; i < results.size(); ++i)
    EXPECT_LT(largest_relative_difference(results[0], results[i]), 2e-5) << "variant " << i;
}

TEST(Ippo, ThreadsWithAMicroBatchEachGiveTheSameGradientEveryTime) {
  std::vector<std::vector<Tensor>> results;
  for (const int64_t threads : {1, 3, 3, 3, 2}) {
    RunConfig config = small_config();
    config.optimisation.micro_batch_size = 16;
    config.collection.learner_threads = threads;
    const TrajectoryShape shape = small_shape(config);
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 7, 3);
    apply_lag_filter(batch, 0, 1000);
    ippo.prepare_targets(batch);
    TermValues terms;
    ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms));
    results.push_back(gradients(ippo.net()));
  }
  for (std::size_t i = 1; i < results.size(); ++i)
    EXPECT_LT(largest_relative_difference(results[0], results[i]), 2e-5) << "variant " << i;
  for (const std::size_t again : {2u, 3u})
    for (std::size_t i = 0; i < results[1].size(); ++i)
      EXPECT_TRUE(torch::equal(results[1][i], results[again][i])) << "parameter " << i;
}

TEST(Ippo, AnAllInvalidTrajectoryAddsNothingToTheGradient) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  std::vector<std::vector<Tensor>> results;
  for (const int slab_count : {3, 4}) {  // the first three hold the same noise
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, slab_count, 4);
    if (slab_count == 4) batch.valid.narrow(1, 6, 2).zero_();
    apply_lag_filter(batch, 0, 1000);
    ippo.prepare_targets(batch);
    TermValues terms;
    ippo.accumulate_gradient(batch, {}, terms);
    results.push_back(gradients(ippo.net()));
  }
  EXPECT_LT(largest_relative_difference(results[0], results[1]), 2e-5);
}

TEST(Ippo, AnAllInvalidBatchLeavesWeightsAndVersionAlone) {
  RunConfig config = small_config();
  config.network.normalize_input = true;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 2, 5);
  batch.policy_version.fill_(-1000);
  std::vector<Tensor> before;
  for (const auto& [name, tensor] : ippo.net().named_state()) before.push_back(tensor.detach().clone());
  const Expected<UpdateStats> stats = ippo.update(batch, {});
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->optimizer_steps, 0);
  EXPECT_EQ(stats->lag.dropped, 16);
  EXPECT_EQ(ippo.version(), 0u);
  std::vector<Tensor> after;
  for (const auto& [name, tensor] : ippo.net().named_state()) after.push_back(tensor.detach());
  EXPECT_TRUE(all_equal(before, after));
}

TEST(Ippo, TwentyBatchesInARowWithoutAValidSampleEndTheRun) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  const auto update = [&](bool is_valid) {
    RolloutBatch batch = noise_batch(shape, 2, 5);
    if (!is_valid) batch.valid.zero_();
    return ippo.update(batch, {});
  };
  for (int i = 0; i < 19; ++i) ASSERT_TRUE(update(false)) << i;
  ASSERT_TRUE(update(true));  // one that is valid, and counting begins anew
  for (int i = 0; i < 19; ++i) ASSERT_TRUE(update(false)) << i;
  const Expected<UpdateStats> last = update(false);
  ASSERT_FALSE(last);
  EXPECT_NE(last.error().message.find("no sample was valid in 20 batches in a row"), std::string::npos)
      << last.error().message;
}

TEST(Ippo, BackPropagationThroughADoneEqualsTwoSeparateRollouts) {
  for (const RnnType rnn_type : {RnnType::kGru, RnnType::kLstm}) {
    RunConfig config = small_config();
    config.network.rnn_type = rnn_type;
    config.collection.rollout = 6;
    const TrajectoryShape shape = small_shape(config);
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 1, 6);
    batch.terminated[2].fill_(1);
    apply_lag_filter(batch, 0, 1000);
    const Tensor weight = torch::randn({6, 2, 6}, torch::make_generator<at::CPUGeneratorImpl>(7));
    const auto loss_of = [&](int64_t begin, int64_t length, const Tensor& state, const Tensor& reset) {
      const policy::SequenceOutput output =
          ippo.net().sequence(batch.frame.narrow(0, begin, length), {}, state, reset);
      const Tensor part = weight.narrow(0, begin, length);
      return (output.logits * part.narrow(2, 0, 5)).sum() + (output.value * part.select(2, 5)).sum();
    };
    const Tensor whole = loss_of(0, 6, batch.recurrent_state, batch.reset);
    whole.backward();
    const std::vector<Tensor> of_whole = gradients(ippo.net());
    const Tensor no_reset = torch::zeros({3, 2}, torch::kUInt8);
    const Tensor first = loss_of(0, 3, batch.recurrent_state, no_reset);
    const Tensor second = loss_of(3, 3, torch::zeros_like(batch.recurrent_state), no_reset);
    (first + second).backward();
    EXPECT_NEAR(whole.item<double>(), (first + second).item<double>(), 1e-4) << word_of(rnn_type);
    EXPECT_LT(largest_relative_difference(of_whole, gradients(ippo.net())), 1e-5) << word_of(rnn_type);
  }
}

TEST(Ippo, AnotherAgentsFrameChangesNeitherValueNorLogits) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  const Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 1, 8);
  torch::NoGradGuard no_grad;
  apply_lag_filter(batch, 0, 1000);
  const policy::SequenceOutput before =
      ippo.net().sequence(batch.frame, {}, batch.recurrent_state, batch.reset);
  batch.frame.select(1, 1).fill_(200);
  const policy::SequenceOutput after =
      ippo.net().sequence(batch.frame, {}, batch.recurrent_state, batch.reset);
  EXPECT_TRUE(torch::allclose(before.logits.select(1, 0), after.logits.select(1, 0), 1e-5, 1e-6));
  EXPECT_TRUE(torch::allclose(before.value.select(1, 0), after.value.select(1, 0), 1e-5, 1e-6));
  EXPECT_FALSE(torch::allclose(before.logits.select(1, 1), after.logits.select(1, 1), 1e-5, 1e-6));
  EXPECT_FALSE(torch::allclose(before.value.select(1, 1), after.value.select(1, 1), 1e-5, 1e-6));
}

TEST(Ippo, ScalingRewardsLeavesNormalizedTargetsUnchanged) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  std::vector<Tensor> targets;
  for (const double scale : {1.0, 25.0}) {
    Ippo ippo(config, shape.env, torch::kCPU);
    StateDict state;
    ippo.save(state);
    state.put("normalizer/returns_mean", 0.3 * scale);  // statistics that saw rewards of this scale
    state.put("normalizer/returns_variance", 2.0 * scale * scale);
    state.put("normalizer/returns_count", 500.0);
    ASSERT_TRUE(ippo.load(state));
    RolloutBatch batch = noise_batch(shape, 4, 9);
    batch.reward.mul_(scale);
    apply_lag_filter(batch, 0, 1000);
    ippo.prepare_targets(batch);
    targets.push_back(batch.target);
  }
  EXPECT_TRUE(torch::allclose(targets[0], targets[1], 1e-4, 1e-5));
}

TEST(Ippo, PopArtKeepsThePredictedReturnsWhenTheirStatisticsMove) {
  for (const bool popart : {false, true}) {
    RunConfig config = small_config();
    config.on_policy.popart = popart;
    const TrajectoryShape shape = small_shape(config);
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 4, 9);
    act_with(ippo.net(), batch);
    batch.reward.mul_(40);  // the statistics of a fresh run are 0 and 1
    const auto returns = [&] {
      torch::NoGradGuard no_grad;
      return ippo.return_normalizer().denormalize(
          ippo.net().sequence(batch.frame, batch.measurement, batch.recurrent_state, batch.reset).value);
    };
    const Tensor before = returns(), old_value = ippo.return_normalizer().denormalize(batch.value);
    ippo.prepare_targets(batch);
    ASSERT_GT(ippo.return_normalizer().sigma(), 10);
    EXPECT_EQ(torch::allclose(returns(), before, 1e-4, 1e-3), popart);
    EXPECT_EQ(torch::allclose(ippo.return_normalizer().denormalize(batch.value), old_value, 1e-4, 1e-3),
              popart)
        << "the old values that the clip is about";
  }
}

TEST(Ippo, ClipAndExplorationAreThoseOfTheRunsEnvFrames) {
  RunConfig scheduled = small_config();
  scheduled.on_policy.ppo_clip_ratio = *Schedule::parse("0.4@0,0.05@1000");
  scheduled.on_policy.exploration_loss_coeff = *Schedule::parse("0@0..0.5@1000");
  const TrajectoryShape shape = small_shape(scheduled);
  const auto updated = [&](const RunConfig& config, double env_frames) {
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 4, 9);
    UpdateContext context;
    context.env_frames = env_frames;
    const Expected<UpdateStats> stats = ippo.update(batch, context);
    EXPECT_TRUE(stats);
    return std::pair(values_of(*stats), copies(ippo.net().parameters()));
  };
  for (const auto& [env_frames, clip, coeff] :
       {std::tuple(0.0, 0.4, 0.0), {500.0, 0.4, 0.25}, {5000.0, 0.05, 0.5}}) {
    RunConfig constant = small_config();
    constant.on_policy.ppo_clip_ratio = clip;
    constant.on_policy.exploration_loss_coeff = coeff;
    const auto [values, weights] = updated(scheduled, env_frames);
    EXPECT_TRUE(all_equal(weights, updated(constant, 0).second)) << env_frames;
    EXPECT_EQ(values.at("train/ppo_clip_ratio"), clip);
    EXPECT_EQ(values.at("train/exploration_loss_coeff"), coeff);
  }
}

TEST(Ippo, AFloorUnderTheAdvantagesDeviationKeepsTheCriticsNoiseSmall) {
  RunConfig config = small_config();
  config.on_policy.advantage_deviation_min = 0.5;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  StateDict state;
  ippo.save(state);
  state.put("normalizer/returns_mean", 0.0);  // of returns far beyond those of this batch
  state.put("normalizer/returns_variance", 1e4);
  state.put("normalizer/returns_count", 1e9);
  ASSERT_TRUE(ippo.load(state));
  RolloutBatch batch = noise_batch(shape, 4, 9);
  batch.value.mul_(1e-3);  // in deviations of returns
  apply_lag_filter(batch, 0, 1000);
  ippo.prepare_targets(batch);
  TermValues terms;
  ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms));
  // Divided by 0.5 x 100, not by their own deviation.
  const Tensor shift =
      (50 * batch.advantage - batch.raw_advantage).masked_select(batch.acting().to(torch::kBool));
  ASSERT_GT(shift.numel(), 4);
  EXPECT_LT((shift.max() - shift.min()).item<double>(), 1e-3);
  EXPECT_LT(batch.advantage.abs().max().item<double>(), 1);
}

TEST(Ippo, InvalidSamplesLowerTheLearningRateByTheirFraction) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 10);
  batch.valid.narrow(1, 0, 2).zero_();
  const Expected<UpdateStats> stats = ippo.update(batch, {});
  ASSERT_TRUE(stats);
  EXPECT_NEAR(values_of(*stats)["train/actual_lr"], 0.75e-4, 1e-12);
  EXPECT_NEAR(values_of(*stats)["train/lr"], 1e-4, 1e-12);
}

TEST(Ippo, ADeadAgentsActionsMoveNoWeightAndLowerNoLearningRate) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  std::vector<std::vector<Tensor>> results;
  for (const int64_t shift : {0, 1}) {  // another action in every head, taken after another policy
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 4, 10);
    batch.agent_active.narrow(0, 2, 2).narrow(1, 0, 3).zero_();
    const Tensor is_dead = batch.agent_active.eq(0);
    const Tensor others = batch.action.add(shift).remainder(2);
    batch.action.copy_(torch::where(is_dead.unsqueeze(2), others, batch.action));
    batch.log_prob.sub_(is_dead * shift);
    batch.logits.add_(is_dead.unsqueeze(2) * torch::arange(5) * shift);
    apply_lag_filter(batch, 0, 1000);
    ippo.prepare_targets(batch);
    RolloutBatch whole = batch;
    TermValues terms;
    ASSERT_TRUE(ippo.accumulate_gradient(whole, {}, terms));
    results.push_back(gradients(ippo.net()));
    EXPECT_NEAR(values_of(*ippo.update(batch, {}))["train/actual_lr"], 1e-4, 1e-12);
  }
  EXPECT_TRUE(all_equal(results[0], results[1]));
}

TEST(Ippo, ReportsWhatTheValuesExplainAndWhatIsClipped) {
  RunConfig config = small_config();
  config.optimisation.returns_clip = 1.0;
  config.on_policy.ppo_clip_value = 1e-3;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 12);
  batch.valid[1][2] = 0;
  apply_lag_filter(batch, 0, 1000);
  RolloutBatch looked_at = batch;
  Ippo twin(config, shape.env, torch::kCPU);
  twin.prepare_targets(looked_at);
  torch::NoGradGuard no_grad;
  const Tensor now = twin.net().sequence(batch.frame, {}, batch.recurrent_state, batch.reset).value;
  // Plain loops over the valid samples, in natural units: returns are advantages and values.
  const auto& returns = twin.return_normalizer();
  std::vector<double> errors, targets;
  double clipped = 0, decides = 0;
  for (int64_t t = 0; t < 4; ++t)
    for (int64_t row = 0; row < 8; ++row) {
      if (batch.valid[t][row].item<int>() == 0) continue;
      const double error = looked_at.raw_advantage[t][row].item<double>();
      const double old_value = batch.value[t][row].item<double>();
      const double target =
          std::clamp(old_value, -1.0, 1.0) * std::sqrt(1 + 1e-5) + error;  // fresh statistics
      errors.push_back(error);
      targets.push_back(target);
      const double wide = (target - returns.statistics().mean) / returns.sigma();
      clipped += std::abs(wide) > 1;
      const double goal = std::clamp(wide, -1.0, 1.0), value = now[t][row].item<double>();
      const double near = old_value + std::clamp(value - old_value, -1e-3, 1e-3);
      decides += (near - goal) * (near - goal) > (value - goal) * (value - goal);
    }
  const auto variance = [](const std::vector<double>& x) {
    double mean = 0, squares = 0;
    for (const double one : x) mean += one / static_cast<double>(x.size());
    for (const double one : x) squares += (one - mean) * (one - mean);
    return squares;
  };
  torch::AutoGradMode with_gradient(true);
  auto values = values_of(*ippo.update(batch, {}));
  EXPECT_NEAR(values.at("train/explained_variance"), 1 - variance(errors) / variance(targets), 1e-4);
  EXPECT_NEAR(values.at("train/targets_clipped_fraction"), clipped / 31, 1e-9);
  EXPECT_GT(clipped, 0);
  EXPECT_NEAR(values.at("train/value_clip_fraction"), decides / 31, 1e-6);
  EXPECT_GT(decides, 0);
  EXPECT_NEAR(values.at("train/entropy_head_0") + values.at("train/entropy_head_1"),
              values.at("train/entropy"), 1e-6);
  EXPECT_LE(values.at("train/entropy_head_0"), std::log(3.0) + 1e-6);
  EXPECT_LE(values.at("train/entropy_head_1"), std::log(2.0) + 1e-6);
}

TEST(Ippo, TheFirstPassOverABatchShowsStalenessAlone) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 4;
  config.optimisation.learning_rate = 1e-2;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch fresh = noise_batch(shape, 4, 1);
  act_with(ippo.net(), fresh);
  auto values = values_of(*ippo.update(fresh, {}));
  EXPECT_NEAR(values.at("train/kl_first"), 0, 1e-6);
  EXPECT_EQ(values.at("train/fraction_clipped_first"), 0);
  EXPECT_GT(values.at("train/kl_divergence"), 1e-5);
  RolloutBatch stale = noise_batch(shape, 4, 2);  // of another policy
  values = values_of(*ippo.update(stale, {}));
  EXPECT_GT(values.at("train/kl_first"), 1e-3);
  EXPECT_GT(values.at("train/fraction_clipped_first"), 0);
}

TEST(Ippo, AMinibatchOfTheDeadTrainsTheirValuesAlone) {
  RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  for (const double value_loss_coeff : {0.0, 0.5}) {
    config.on_policy.value_loss_coeff = value_loss_coeff;
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 4, 10);
    batch.agent_active.zero_();
    apply_lag_filter(batch, 0, 1000);
    ippo.prepare_targets(batch);
    TermValues terms;
    ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms));
    EXPECT_EQ(terms["policy_loss"] + terms["exploration_loss"] + terms["kl_loss"], 0);
    double largest = 0;
    for (const Tensor& gradient : gradients(ippo.net())) {
      EXPECT_TRUE(gradient.isfinite().all().item<bool>());
      largest = std::max(largest, gradient.abs().max().item<double>());
    }
    EXPECT_EQ(largest > 0, value_loss_coeff > 0);
    const Expected<UpdateStats> stats = ippo.update(batch, {});
    ASSERT_TRUE(stats);
    EXPECT_EQ(stats->skipped_steps, 0);
    EXPECT_FALSE(values_of(*stats).contains("train/adv_mean"));
  }
}

TEST(Ippo, ARewardPaidAfterDeathReachesTheLastLivingDecision) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  std::vector<Tensor> advantages;
  for (const float reward : {0.0f, 1.0f}) {
    const SlabPool pool(shape, 1);
    pool.fill_with_noise(3);
    const SlabView slab = pool.view(0);
    for (int t = 2; t < 4; ++t) {  // dead since step 1: nothing is allowed any more
      slab.agent_active(t, 0) = 0;
      std::ranges::fill(slab.action_mask(t, 0), uint8_t{0});
    }
    slab.reward(2, 0) = reward;
    RolloutBatch batch = make_rollout_batch(shape, 1);
    clear(batch);
    ASSERT_EQ(collate_slab(batch, 0, slab, 4), 0);
    apply_lag_filter(batch, 0, 1000);
    Ippo(config, shape.env, torch::kCPU).prepare_targets(batch);
    EXPECT_EQ(batch.acting()[1][0].item<int>(), 1);
    EXPECT_EQ(batch.acting()[2][0].item<int>(), 0);
    EXPECT_EQ(batch.valid[2][0].item<int>(), 1);
    advantages.push_back(batch.raw_advantage);
  }
  const Tensor paid = advantages[1] - advantages[0];
  EXPECT_NEAR(paid[1][0].item<double>(), config.optimisation.gamma * config.on_policy.gae_lambda, 1e-5);
  EXPECT_NEAR(paid[2][0].item<double>(), 1, 1e-5);
  EXPECT_EQ(paid[1][1].item<double>(), 0);
}

TEST(Ippo, ReportsTheRunningStatisticsOfFramesAndReturns) {
  RunConfig config = small_config();
  config.network.normalize_input = true;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 15);
  auto values = values_of(*ippo.update(batch, {}));
  // 32 uniform bytes merged with the fresh statistics (mean 0, one sample); in units of the network's input.
  const double scale = values.at("train/obs_running_mean") > 1 ? 1.0 : 255.0;
  EXPECT_NEAR(values.at("train/obs_running_mean") * scale, 127.5 * 32 / 33, 2);
  EXPECT_GT(values.at("train/obs_running_std"), 0);
  EXPECT_GT(values.at("train/returns_running_std"), 0);
  EXPECT_TRUE(std::isfinite(values.at("train/returns_running_mean")));
}

TEST(Ippo, StopsEarlyWhenTheActorLossStandsStill) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 5;
  config.optimisation.learning_rate = 0;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 2, 11);
  EXPECT_EQ(ippo.update(batch, {})->optimizer_steps, 2);
  config.optimisation.learning_rate = 1e-2;
  Ippo moving(config, shape.env, torch::kCPU);
  EXPECT_EQ(moving.update(batch, {})->optimizer_steps, 5);
}

TEST(Ippo, CountsOneVersionPerOptimizerStepAndReportsEachOne) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 2;
  config.optimisation.num_batches_per_epoch = 3;
  config.optimisation.shuffle_minibatches = true;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 5, 12);
  std::vector<PolicyVersion> told;
  UpdateContext context;
  context.after_step = [&] { told.push_back(ippo.version()); };
  const Expected<UpdateStats> stats = ippo.update(batch, context);
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->optimizer_steps, 6);
  EXPECT_EQ(stats->rows_trained, 2 * 5 * 2 * 4);
  EXPECT_EQ(told, (std::vector<PolicyVersion>{1, 2, 3, 4, 5, 6}));
}

TEST(Ippo, AnAbandonedStepChangesNothing) {
  RunConfig config = small_config();
  config.optimisation.micro_batch_size = 8;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 13);
  const std::vector<Tensor> before = copies(ippo.net().parameters());
  int asked = 0;
  UpdateContext context;
  context.keep_going = [&] { return ++asked < 3; };
  const Expected<UpdateStats> stats = ippo.update(batch, context);
  ASSERT_TRUE(stats);
  EXPECT_TRUE(stats->abandoned);
  EXPECT_EQ(ippo.version(), 0u);
  EXPECT_TRUE(all_equal(before, ippo.net().parameters()));
}

TEST(Ippo, SkipsStepsThatAreNotFiniteAndGivesUpAfterTooManyInARow) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  const std::vector<Tensor> before = copies(ippo.net().parameters());
  RolloutBatch batch = noise_batch(shape, 1, 14);
  const Tensor recurrent_state = batch.recurrent_state.clone();
  int skipped = 0;
  Expected<UpdateStats> stats = UpdateStats{};
  while (skipped < 100) {
    batch.recurrent_state.fill_(std::numeric_limits<float>::quiet_NaN());
    stats = ippo.update(batch, {});
    if (!stats) break;
    EXPECT_EQ(stats->skipped_steps, 1);
    ++skipped;
  }
  ASSERT_FALSE(stats);
  EXPECT_GE(skipped, 5);
  EXPECT_NE(stats.error().message.find("not finite"), std::string::npos);
  EXPECT_TRUE(all_equal(before, ippo.net().parameters()));
  batch.recurrent_state.copy_(recurrent_state);  // and a sound batch continues
  EXPECT_EQ(ippo.update(batch, {})->optimizer_steps, 1);
}

TEST(Ippo, AReloadedRunContinuesBitForBit) {
  RunConfig config = small_config();
  config.network.normalize_input = true;
  config.optimisation.num_epochs = 2;
  config.optimisation.shuffle_minibatches = true;
  config.optimisation.num_batches_per_epoch = 2;
  const TrajectoryShape shape = small_shape(config);
  const auto train = [&](Ippo& ippo, uint64_t first, uint64_t last) {
    for (uint64_t seed = first; seed < last; ++seed) {
      RolloutBatch batch = noise_batch(shape, 4, seed);
      UpdateContext context;
      context.env_frames = static_cast<double>(seed);
      ASSERT_TRUE(ippo.update(batch, context));
    }
  };
  Ippo whole(config, shape.env, torch::kCPU);
  train(whole, 20, 26);
  Ippo first_half(config, shape.env, torch::kCPU);
  train(first_half, 20, 23);
  StateDict state;
  first_half.save(state);
  Ippo second_half(config, shape.env, torch::kCPU);
  ASSERT_TRUE(second_half.load(state));
  EXPECT_EQ(second_half.version(), first_half.version());
  train(second_half, 23, 26);
  EXPECT_EQ(second_half.version(), whole.version());
  EXPECT_TRUE(second_half.weights() == whole.weights());
}

TEST(Ippo, RefusesACheckpointOfAnotherModel) {
  RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  const Ippo small(config, shape.env, torch::kCPU);
  StateDict state;
  small.save(state);
  config.network.rnn_size = 24;
  Ippo large(config, shape.env, torch::kCPU);
  const Status loaded = large.load(state);
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::kBadFormat);
  EXPECT_FALSE(large.load(StateDict()));
}

TEST(Ippo, LearnsTheBestArmOfABandit) {
  RunConfig config;
  config.run.algo = "ippo";
  config.collection.rollout = 8;
  config.network.use_rnn = false;
  config.network.normalize_input = false;
  config.optimisation.learning_rate = 1e-2;
  TrajectoryShape shape;
  shape.env.num_agents = 1;
  shape.env.height = shape.env.width = 36;
  shape.env.head_count = 1;
  shape.env.head_sizes = {2};
  shape.rollout_steps = 8;
  shape.recurrent_state_count = 0;
  Ippo ippo(config, shape.env, torch::kCPU);
  const SlabPool pool(shape, 4);
  RolloutBatch batch = make_rollout_batch(shape, 4);
  const Tensor frame = torch::full({1, 3, 36, 36}, 128, torch::kUInt8);
  const RngKey key = RngKey(1).split("bandit");
  double best = 0;
  for (uint64_t update = 0; update < 300 && best <= 0.95; ++update) {
    const policy::PolicyOutput output = ippo.net().step(frame, {}, torch::zeros({1, 0}));
    const Tensor logits = output.logits[0].contiguous();
    best = torch::softmax(logits, 0)[0].item<double>();
    clear(batch);
    for (int i = 0; i < 4; ++i) {
      const SlabView slab = pool.view(i);
      for (int t = 0; t < 8; ++t) {
        std::fill(slab.frame(t, 0).begin(), slab.frame(t, 0).end(), uint8_t{128});
        std::copy_n(logits.data_ptr<float>(), 2, slab.logits(t, 0).begin());
        slab.log_prob(t, 0) = policy::sample_action(slab.logits(t, 0), slab.action_mask(t, 0), shape.env,
                                                    key.split(update).split(static_cast<uint64_t>(i * 8 + t)),
                                                    false, slab.action(t, 0));
        slab.value(t, 0) = output.value.item<float>();
        slab.reward(t, 0) = slab.action(t, 0)[0] == 0 ? 1.0f : 0.0f;
        slab.terminated(t) = 1;
        slab.policy_version(t, 0) = ippo.version();
      }
      ASSERT_EQ(collate_slab(batch, i, slab, 8), 0);
    }
    ASSERT_TRUE(ippo.update(batch, {}));
  }
  EXPECT_GT(best, 0.95);
}

RunConfig vtrace_config() {
  RunConfig config = small_config();
  config.on_policy.with_vtrace = true;
  config.optimisation.normalize_returns = false;
  return config;
}

TEST(IppoWithVtrace, OfFreshDataIsGaeWithLambdaOne) {
  const RunConfig config = vtrace_config();
  RunConfig gae_config = small_config();
  gae_config.optimisation.normalize_returns = false;
  gae_config.on_policy.gae_lambda = 1;
  const TrajectoryShape shape = small_shape(config);
  Ippo vtrace(config, shape.env, torch::kCPU), gae(gae_config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 3, 16);
  act_with(vtrace.net(), batch);
  batch.terminated[1][2] = 1;
  batch.truncated[2][4] = 1;
  batch.final_value[2][4] = 0.7f;
  apply_lag_filter(batch, 0, 1000);
  act_with(vtrace.net(), batch);  // again: the ends above reset the recurrent state
  gae.prepare_targets(batch);
  const Tensor advantage = batch.advantage.clone(), target = batch.target.clone();
  vtrace.prepare_vtrace(batch);
  EXPECT_TRUE(torch::allclose(batch.advantage, advantage, 1e-4, 1e-5));
  EXPECT_TRUE(torch::allclose(batch.target, target, 1e-4, 1e-5));
}

TEST(IppoWithVtrace, LooksAtThePolicyInTraining) {
  // Behaviour log-probabilities that say every action was half as likely: all ratios are 2, capped at 1.
  const RunConfig config = vtrace_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 2, 17);
  act_with(ippo.net(), batch);
  ippo.prepare_vtrace(batch);
  const Tensor on_policy = batch.advantage.clone();
  batch.log_prob.sub_(std::log(2.0));
  ippo.prepare_vtrace(batch);
  EXPECT_TRUE(torch::allclose(batch.advantage, on_policy, 1e-4, 1e-5));
  batch.log_prob.add_(2 * std::log(2.0));  // ratio 1/2: not capped
  ippo.prepare_vtrace(batch);
  EXPECT_FALSE(torch::allclose(batch.advantage, on_policy, 1e-2, 1e-3));
}

TEST(IppoWithVtrace, AnInvalidStepCutsTheTraceAndAShortSlabBootstrapsFromItsStoredValue) {
  const RunConfig config = vtrace_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 2, 18);
  act_with(ippo.net(), batch);
  batch.valid[2][0] = 0;
  apply_lag_filter(batch, 0, 1000);
  ippo.prepare_vtrace(batch);
  EXPECT_NEAR(batch.target[2][0].item<double>(), batch.value[2][0].item<double>(), 0.2);
  EXPECT_EQ(batch.advantage[2][0].item<double>(), 0);
  const Tensor before = batch.advantage.clone();
  batch.reward[3][0] += 5;  // behind the cut
  ippo.prepare_vtrace(batch);
  EXPECT_EQ(batch.advantage[1][0].item<double>(), before[1][0].item<double>());
  EXPECT_NE(batch.advantage[3][0].item<double>(), before[3][0].item<double>());
  batch.value[4][1] += 1;  // the stored bootstrap behind the last step
  ippo.prepare_vtrace(batch);
  EXPECT_NEAR((batch.advantage - before)[3][1].item<double>(), 0.99, 1e-4);
}

TEST(IppoWithVtrace, WhatADeadAgentDoesNeitherCutsNorBendsTheTrace) {
  const RunConfig config = vtrace_config();
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 2, 18);
  act_with(ippo.net(), batch);
  batch.agent_active[2][0] = batch.agent_active[3][0] = 0;
  apply_lag_filter(batch, 0, 1000);
  ippo.prepare_vtrace(batch);
  const Tensor before = batch.advantage.clone(), target = batch.target.clone();
  batch.log_prob[2][0] += 5;  // another policy would hardly have done that
  ippo.prepare_vtrace(batch);
  EXPECT_TRUE(torch::equal(batch.advantage, before));
  EXPECT_TRUE(torch::equal(batch.target, target));
  batch.reward[3][0] += 1;
  ippo.prepare_vtrace(batch);
  EXPECT_NEAR((batch.advantage - before)[1][0].item<double>(), 0.99 * 0.99, 1e-3);
}

TEST(IppoWithVtrace, TrainsAndMicroBatchesGiveTheSameGradient) {
  std::vector<std::vector<Tensor>> results;
  for (const int64_t micro_batch_size : {4096, 8}) {
    RunConfig config = vtrace_config();
    config.optimisation.micro_batch_size = micro_batch_size;
    const TrajectoryShape shape = small_shape(config);
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 5, 19);
    apply_lag_filter(batch, 0, 1000);
    TermValues terms;
    ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms));
    results.push_back(gradients(ippo.net()));
    RolloutBatch again = noise_batch(shape, 5, 19);
    EXPECT_EQ(ippo.update(again, {})->optimizer_steps, 1);
  }
  EXPECT_LT(largest_relative_difference(results[0], results[1]), 2e-5);
}

TEST(Ippo, LeavesABatchOnceThePolicyMovedTooFar) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 6;
  config.optimisation.learning_rate = 1e-2;
  const TrajectoryShape shape = small_shape(config);
  std::map<double, int64_t> steps;
  for (const double limit : {0.0, 1e-5, 1e9}) {
    config.on_policy.early_stop_kl = limit;
    Ippo ippo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 4, 20);
    act_with(ippo.net(), batch);
    steps[limit] = ippo.update(batch, {})->optimizer_steps;
  }
  EXPECT_EQ(steps[0.0], 6);
  EXPECT_EQ(steps[1e9], 6);
  EXPECT_EQ(steps[1e-5], 1);
}

TEST(Ippo, SeparateNetworksLearnFromTheirOwnAgentAlone) {
  RunConfig config = small_config();
  config.network.share_parameters = false;
  const TrajectoryShape shape = small_shape(config);
  Ippo ippo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 21);
  batch.valid.slice(1, 1, c10::nullopt, 2).zero_();  // agent 1 has nothing to learn from
  apply_lag_filter(batch, 0, 1000);
  ippo.prepare_targets(batch);
  TermValues terms;
  ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms));
  for (const auto& [agent, learns] : {std::pair(0, true), {1, false}}) {
    double norm = 0;
    for (const Tensor& parameter : ippo.net().actor_parameters(agent))
      norm += parameter.grad().abs().sum().item<double>();
    EXPECT_EQ(norm > 0, learns) << agent;
  }
}

TEST(Ippo, Bf16LossesAgreeWithFp32) {
  for (const char* algo : {"ippo", "mappo"}) {
    std::vector<TermValues> terms;
    std::vector<std::vector<Tensor>> results;
    for (const Precision precision : {Precision::kFp32, Precision::kBf16}) {
      RunConfig config = small_config();
      config.run.algo = algo;
      config.collection.precision = precision;
      const TrajectoryShape shape = small_shape(config);
      Ippo ippo(config, shape.env, torch::kCPU);
      RolloutBatch batch = noise_batch(shape, 8, 22);
      apply_lag_filter(batch, 0, 1000);
      ippo.prepare_targets(batch);
      terms.emplace_back();
      ASSERT_TRUE(ippo.accumulate_gradient(batch, {}, terms.back()));
      results.push_back(gradients(ippo.net()));
    }
    // bfloat16 keeps 8 bits, so single products are off by up to 0.4 %.
    EXPECT_NEAR(terms[0]["policy_loss"], terms[1]["policy_loss"], 0.01) << algo;
    EXPECT_NEAR(terms[0]["value_loss"], terms[1]["value_loss"], 0.02 * terms[0]["value_loss"]) << algo;
    EXPECT_NEAR(terms[0]["entropy"], terms[1]["entropy"], 0.01 * terms[0]["entropy"]) << algo;
    EXPECT_NEAR(terms[0]["exploration_loss"], terms[1]["exploration_loss"],
                0.02 * terms[0]["exploration_loss"])
        << algo;
    EXPECT_NE(terms[0]["policy_loss"], terms[1]["policy_loss"]) << algo;
    EXPECT_LT(largest_relative_difference(results[0], results[1]), 0.03) << algo;
  }
}

// What a GPU is given by an update of one optimizer step, but for the recurrent core, whose cell is fused there. It is as many for
// any number of rows and steps.
TEST(Ippo, AnUpdateStartsABoundedNumberOfKernels) {
  if (!cpu_multiplies_bf16())
    GTEST_SKIP() << "this processor has no bf16 products, so factors are rounded back";
  RunConfig config = small_config();
  config.network.encoder = "impala";
  config.network.use_rnn = false;
  config.network.normalize_input = true;
  config.collection.precision = Precision::kBf16;
  config.collection.learner_threads = 1;
  const TrajectoryShape shape = small_shape(config);
  const device::OperatorPath as_on_a_device;
  const auto algorithm = *make_algorithm(config, shape.env, torch::kCPU);
  UpdateContext context;
  context.reports = false;
  int64_t kernels[2] = {}, bytes[2] = {};
  for (const int slabs : {4, 8}) {
    RolloutBatch first = noise_batch(shape, slabs, 1), batch = noise_batch(shape, slabs, 2);
    (void)*algorithm->on_policy()->update(first, context);  // what is made once is made
    const test::OperatorCount count;
    const UpdateStats stats = *algorithm->on_policy()->update(batch, context);
    EXPECT_EQ(stats.optimizer_steps, 1);
    kernels[slabs / 8] = count.kernels();
    bytes[slabs / 8] = count.bytes();
  }
  EXPECT_EQ(kernels[0], kernels[1]);
  EXPECT_LE(kernels[0], 452);
  EXPECT_LE((bytes[1] - bytes[0]) / (4 * kAgents * shape.rollout_steps), 200'000) << "bytes of a decision";
}

}  // namespace ippo_test
}  // namespace comrad::learn
