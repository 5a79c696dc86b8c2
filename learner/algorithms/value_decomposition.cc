#include "learner/algorithms/value_decomposition.h"

#include "learner/estimators/td_targets.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "policy_workers/network/utilities.h"

namespace comrad::learn {

Tensor ValueDecomposition::sample_valid(const ReplayBatch& batch) const {
  return batch.valid.view({batch.steps(), batch.world_count, batch.shape.env.num_agents}).amin(2);
}

SampleLoss ValueDecomposition::loss_of(const Scene& scene) const {
  const ReplayBatch& batch = scene.batch;
  const int64_t steps = batch.steps(), worlds = batch.world_count, agents = batch.shape.env.num_agents;
  const auto of_worlds = [&](const Tensor& of_rows) { return of_rows.reshape({steps * worlds, -1}); };
  const auto state_of = [&](const Tensor& features) {
    const double deviation = config_.mixers.mixer_state_deviation;
    return deviation == 0 ? features : at::layer_norm(features, {features.size(2)}) * deviation;
  };
  // Row = world * N + agent: the last axes of [T, R, ...] fold into one row per world.
  const auto input = [&](const QValues& values, bool is_next, const Tensor& action, const Tensor& mask,
                         const Tensor& active) {
    const Tensor& q = is_next ? values.next : values.now;
    const Tensor is_active = active.to(torch::kFloat32);
    const Tensor features = of_worlds(state_of(is_next ? values.next_state : values.state));
    const Tensor& truth = is_next ? scene.next_state : scene.state;
    return MixerInput{
        .chosen = of_worlds(policy::chosen_utility(q, action, env_) * is_active),
        .greedy = of_worlds(policy::greedy_utility(q.detach(), mask, env_) * is_active),
        // What an agent that is out of the game was asked to do carries no information about the team's value.
        .action = of_worlds(policy::multi_hot(action, env_) * is_active.unsqueeze(-1)),
        .state = truth.defined() ? at::cat({features, of_worlds(truth)}, 1) : features};
  };
  const MixerInput now =
      input(scene.online, false, batch.action, scene.mask(), batch.agent_active.narrow(0, 0, steps));
  const MixerOutput mixed = mixer_->mix(now);
  const auto by_time = [&](const Tensor& of_samples) {
    return of_samples.defined() ? of_samples.view({steps, worlds}) : of_samples;
  };
  const Tensor q_tot = by_time(mixed.q_tot);
  Tensor target, unclamped;
  {
    torch::NoGradGuard no_grad;
    const Tensor best = next_action(scene);
    const Tensor next = by_time(
        target_mixer_->mix(input(scene.target, true, best, scene.next_mask, scene.next_active)).q_tot);
    const auto first_of = [&](const Tensor& of_rows) {
      return of_rows.view({steps, worlds, agents}).select(2, 0).contiguous();
    };
    const Tensor rewards = batch.reward.view({steps, worlds, agents});
    target = unclamped = td_targets(
        {.reward = (config_.q_learning.team_reward == TeamReward::kMean ? rewards.mean(2) : rewards.sum(2))
                       .contiguous(),
         .terminated = first_of(batch.terminated),
         .truncated = first_of(batch.truncated),
         .next_value = next * (first_of(batch.bootstrap) * scene.sigma),
         .valid = sample_valid(batch).contiguous()},
        {.gamma = config_.optimisation.gamma,
         .n_step = steps > 1 ? n_step() : 1,
         .lambda = config_.q_learning.td_lambda,
         .legacy_timeouts = config_.optimisation.legacy_timeouts});
    if (config_.q_learning.q_value_clamp > 0)
      target = unclamped.clamp(-config_.q_learning.q_value_clamp, config_.q_learning.q_value_clamp);
  }
  const Tensor error = q_tot - target / scene.sigma;
  return {.loss = loss_of_error(error),
          .regularizer = by_time(mixed.regularizer),
          .error = error.detach().abs() * scene.sigma,
          .predicted = q_tot.detach() * scene.sigma,
          .target = target,
          .unclamped = unclamped,
          .head_entropy = by_time(mixed.head_entropy),
          .mixer_gain = by_time(mixed.gain),
          .state_rms = mixed.gain.defined() ? by_time(now.state.square().mean(1).sqrt()) : Tensor()};
}

}  // namespace comrad::learn
