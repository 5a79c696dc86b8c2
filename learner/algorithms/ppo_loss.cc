#include "learner/algorithms/ppo_loss.h"

#include "policy_workers/policy/action_heads.h"
#include "policy_workers/policy/torch_ops.h"

namespace comrad::learn {
namespace {

constexpr double kStandardDeviationFloor = 1e-7;

}  // namespace

Tensor importance_ratio(const Tensor& log_prob, const Tensor& behaviour_log_prob) {
  return (log_prob - behaviour_log_prob).exp().clamp(kRatioMin, kRatioMax);
}

Tensor clipped_objective(const Tensor& ratio, const Tensor& advantage, double clip_ratio) {
  const double high = 1.0 + clip_ratio;
  return torch::min(ratio * advantage, ratio.clamp(1.0 / high, high) * advantage);
}

Tensor clipped_value_loss(const Tensor& value, const Tensor& old_value, const Tensor& target,
                          double clip_value) {
  const Tensor near_old = old_value + (value - old_value).clamp(-clip_value, clip_value);
  return torch::max((value - target).square(), (near_old - target).square());
}

Tensor standardize(const Tensor& advantage, const Tensor& valid) {
  // Operators alone, so that nothing waits where the batch lies on a GPU. Without a valid sample all is 0 by its weight.
  const Tensor weight = valid.to(torch::kFloat64);
  const Tensor count = weight.sum();
  const Tensor wide =
      torch::where(valid.to(torch::kBool), advantage.to(torch::kFloat64), torch::zeros({}, weight.options()));
  const Tensor centred = (wide - wide.sum() / count.clamp_min(1.0)) * weight;
  const Tensor deviation = (centred.square().sum() / (count - 1).clamp_min(1.0)).sqrt();
  return (centred / deviation.clamp_min(kStandardDeviationFloor)).to(torch::kFloat32);
}

Tensor exploration_loss(const Tensor& log_probs, const Tensor& mask, const EnvShape& env,
                        ExplorationLoss kind) {
  if (kind == ExplorationLoss::kEntropy) return -policy::entropy(log_probs, env);
  if (kind == ExplorationLoss::kNone) return torch::zeros(log_probs.sizes().slice(0, log_probs.dim() - 1));
  const Tensor divergence =
      policy::symmetric_kl_to_uniform(log_probs, mask, env).clamp_max(kExplorationLossMax);
  return torch::where(divergence.isfinite(), divergence, torch::zeros_like(divergence));
}

}  // namespace comrad::learn
