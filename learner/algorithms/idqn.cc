#include "learner/algorithms/idqn.h"

#include "learner/estimators/td_targets.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "policy_workers/network/utilities.h"

namespace comrad::learn {

Tensor Idqn::sample_valid(const ReplayBatch& batch) const {
  return batch.valid.bitwise_and(batch.agent_active.narrow(0, 0, batch.steps()));
}

SampleLoss Idqn::loss_of(const Scene& scene) const {
  const ReplayBatch& batch = scene.batch;
  const Tensor chosen = policy::chosen_entries(scene.online.now, batch.action, env_);  // [T, R, heads]
  Tensor target;
  {
    torch::NoGradGuard no_grad;
    const Tensor best = next_action(scene);
    const Tensor next =
        policy::chosen_entries(scene.target.next, best, env_) * (batch.bootstrap.unsqueeze(-1) * scene.sigma);
    const auto per_head = [&](const Tensor& of_rows) {
      return of_rows.unsqueeze(-1).expand_as(next).flatten(1).contiguous();
    };
    target = td_targets({.reward = per_head(batch.reward),
                         .terminated = per_head(batch.terminated),
                         .truncated = per_head(batch.truncated),
                         .next_value = next.flatten(1).contiguous(),
                         .valid = per_head(batch.valid)},
                        {.gamma = config_.optimisation.gamma,
                         .n_step = batch.steps() > 1 ? n_step() : 1,
                         .lambda = config_.q_learning.td_lambda,
                         .legacy_timeouts = config_.optimisation.legacy_timeouts})
                 .view_as(next);
  }
  const Tensor error = chosen - target / scene.sigma;
  return {.loss = loss_of_error(error).mean(-1),
          .regularizer = {},
          .error = error.detach().abs().mean(-1) * scene.sigma,
          .predicted = chosen.detach().mean(-1) * scene.sigma,
          .target = target.mean(-1),
          .unclamped = {}};
}

}  // namespace comrad::learn
