#include "learner/losses/ppo_loss.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"

namespace comrad::learn {
namespace {

constexpr double kStandardDeviationFloor = 1e-7;

}  // namespace

Tensor importance_ratio(const Tensor& log_prob, const Tensor& behaviour_log_prob) {
  return (log_prob - behaviour_log_prob).exp().clamp(kRatioMin, kRatioMax);
}

ClipInterval ClipInterval::of(const Tensor& clip_ratio) {
  const Tensor high = 1.0 + clip_ratio;
  return {.low = high.reciprocal().to(torch::kFloat32), .high = high.to(torch::kFloat32)};
}

Tensor clipped_objective(const Tensor& ratio, const Tensor& advantage, const ClipInterval& clip) {
  // Not clamp(): its bounds must lie where the ratio does, these may be numbers of the host.
  return torch::min(ratio * advantage, ratio.maximum(clip.low).minimum(clip.high) * advantage);
}

Tensor clipped_value_loss(const Tensor& value, const Tensor& old_value, const Tensor& target,
                          double clip_value) {
  const Tensor near_old = old_value + (value - old_value).clamp(-clip_value, clip_value);
  return torch::max((value - target).square(), (near_old - target).square());
}

Tensor standardize(const Tensor& advantage, const Tensor& valid, double floor) {
  // Operators alone, so that nothing waits where the batch lies on a GPU. Without a valid sample all is 0 by its weight.
  const Tensor weight = valid.to(torch::kFloat64);
  const Tensor count = weight.sum();
  const Tensor wide =
      torch::where(valid.to(torch::kBool), advantage.to(torch::kFloat64), torch::zeros({}, weight.options()));
  const Tensor centred = (wide - wide.sum() / count.clamp_min(1.0)) * weight;
  const Tensor deviation = (centred.square().sum() / (count - 1).clamp_min(1.0)).sqrt();
  return (centred / deviation.clamp_min(std::max(kStandardDeviationFloor, floor))).to(torch::kFloat32);
}

Tensor exploration_loss(const Tensor& log_probs, const Tensor& mask, const EnvShape& env,
                        ExplorationLoss kind) {
  if (kind == ExplorationLoss::kEntropy) return -policy::entropy(log_probs, env);
  if (kind == ExplorationLoss::kNone) return torch::zeros(log_probs.sizes().slice(0, log_probs.dim() - 1));
  const Tensor divergence =
      policy::symmetric_kl_to_uniform(log_probs, mask, env).clamp_max(kExplorationLossMax);
  return torch::where(divergence.isfinite(), divergence, torch::zeros_like(divergence));
}

PpoOptions PpoOptions::from(const RunConfig& config) {
  return {.clip_value = config.on_policy.ppo_clip_value,
          .value_coeff = config.on_policy.value_loss_coeff,
          .kl_coeff = config.on_policy.kl_loss_coeff,
          .exploration = config.on_policy.exploration_loss};
}

PpoScalars::PpoScalars(std::span<const Tensor> scalars)
    : valid_count(scalars[0]),
      acting_count(scalars[1]),
      clip_ratio(scalars[2]),
      exploration_coeff(scalars[3]) {}

void add_policy_loss(LossTerms& terms, const Tensor& logits, const RolloutBatch& rows,
                     const PpoScalars& scalars, const PpoOptions& options) {
  const EnvShape& env = rows.shape.env;
  const Tensor acting = rows.acting().to(torch::kBool);
  const Tensor weight = acting.to(torch::kFloat32) / scalars.acting_count;
  const Tensor mask = rows.mask_or_undefined();
  const Tensor log_probs = policy::head_log_probs(logits, mask, env);
  const Tensor log_prob = policy::action_log_prob(log_probs, rows.action, env);
  const Tensor ratio = importance_ratio(log_prob, rows.log_prob);
  const ClipInterval clip = ClipInterval::of(scalars.clip_ratio);
  terms.add("policy_loss", -(clipped_objective(ratio, rows.advantage, clip) * weight).sum());
  const Tensor none = torch::zeros({}, weight.options());
  terms.add("exploration_loss",
            options.exploration == ExplorationLoss::kNone
                ? none
                : scalars.exploration_coeff.to(torch::kFloat32) *
                      (exploration_loss(log_probs, mask, env, options.exploration) * weight).sum());
  const auto divergence = [&] {
    return policy::kl_divergence(log_probs, policy::head_log_probs(rows.logits, mask, env), env);
  };
  Tensor kl;
  if (options.kl_coeff != 0) kl = divergence();
  terms.add("kl_loss", kl.defined() ? options.kl_coeff * (kl * weight).sum() : none);

  torch::NoGradGuard no_grad;
  if (!kl.defined()) kl = divergence();
  terms.mean("kl_divergence", kl, weight);
  terms.max("kl_divergence_max", kl, acting, 0);
  const Tensor head_entropy = policy::head_entropies(log_probs, env);
  terms.mean("entropy", head_entropy.sum(-1), weight);
  for (int64_t head = 0; head < env.head_count; ++head)
    terms.mean(fmt::format("entropy_head_{}", head), head_entropy.select(-1, head), weight);
  terms.mean("ratio_mean", ratio, weight);
  terms.min("ratio_min", ratio, acting, 1);
  terms.max("ratio_max", ratio, acting, 1);
  terms.mean("fraction_clipped", ((ratio < clip.low) | (ratio > clip.high)).to(torch::kFloat32), weight);
  terms.max("max_abs_logprob", log_prob.abs(), acting, 0);
  terms.kept = log_prob.detach();
}

void add_value_loss(LossTerms& terms, const Tensor& value, const RolloutBatch& rows,
                    const PpoScalars& scalars, const PpoOptions& options) {
  const Tensor valid = rows.valid.to(torch::kBool);
  const Tensor weight = valid.to(torch::kFloat32) / scalars.valid_count;
  const Tensor old_value = rows.value.narrow(0, 0, rows.steps());
  const Tensor of_samples = clipped_value_loss(value, old_value, rows.target, options.clip_value);
  terms.add("value_loss", options.value_coeff * (of_samples * weight).sum());

  torch::NoGradGuard no_grad;
  terms.mean("value_clip_fraction", (of_samples > (value - rows.target).square()).to(torch::kFloat32),
             weight);
  terms.mean("value", value, weight);
  const Tensor delta = (value - old_value).abs();
  terms.mean("value_delta", delta, weight);
  terms.max("value_delta_max", delta, valid, 0);
}

LossTerms ppo_loss(const policy::SequenceOutput& output, const RolloutBatch& rows, const PpoScalars& scalars,
                   const PpoOptions& options) {
  LossTerms terms;
  if (output.logits.defined()) add_policy_loss(terms, output.logits, rows, scalars, options);
  if (output.value.defined()) add_value_loss(terms, output.value, rows, scalars, options);
  return terms;
}

}  // namespace comrad::learn
