#include "learner/algorithms/ippo.h"

#include <limits>

#include "learner/estimators/vtrace.h"
#include "learner/losses/ppo_loss.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {

Ippo::Ippo(const RunConfig& config, const EnvShape& env, torch::Device device)
    : OnPolicy(config, env, device) {
  optimizers_.emplace_back("", AdamOptimizer(net_.parameters(), AdamSettings::from(config)));
}

OnPolicy::Phase Ippo::phase() {
  return {.optimizer = optimizers_.front().second,
          .forward = [this](const policy::SequenceInput& input) { return net_.sequence(input); },
          .prepare =
              [this](RolloutBatch& minibatch) {
                if (config_.on_policy.with_vtrace) prepare_vtrace(minibatch);
                minibatch.advantage = standardized(minibatch.advantage, minibatch.acting());
              }};
}

Expected<UpdateStats> Ippo::update(RolloutBatch& batch, const UpdateContext& context) {
  UpdateStats stats;
  COMRAD_TRY_ASSIGN(const bool is_valid, begin_update(batch, context, stats));
  if (!is_valid) return stats;
  prepare_targets(batch);
  TermValues terms;
  COMRAD_TRY_ASSIGN(const PhaseEnd end,
                    train_phase(to_device(batch, device_), phase(), context, stats, terms));
  stats.abandoned = end == PhaseEnd::kAbandoned;
  if (context.reports && stats.optimizer_steps > 0 && !stats.abandoned) report(batch, terms, stats);
  return stats;
}

void Ippo::prepare_vtrace(RolloutBatch& minibatch) {
  torch::NoGradGuard no_grad;
  if (!minibatch.host_valid.defined()) minibatch = to_device(minibatch, device_);
  // The recursion over time runs on the host, so this setting does wait for the device, once a minibatch.
  const Evaluation of_device = evaluate(minibatch, phase());
  const Evaluation now{.log_prob = of_device.log_prob.cpu(), .value = of_device.value.cpu()};
  // A ratio of 0 at an invalid step makes its target its own value and lets no trace through. Whatever a dead
  // agent chooses, the same follows: its ratio is 1.
  const Tensor of_alive = torch::where(minibatch.agent_active.cpu().to(torch::kBool),
                                       now.log_prob - minibatch.log_prob.cpu(), torch::zeros({}));
  const Tensor log_rho = torch::where(minibatch.host_valid.to(torch::kBool), of_alive,
                                      torch::full({}, -std::numeric_limits<float>::infinity()));
  // Behind the last step taken stands the stored bootstrap; there is no frame to look at again.
  Tensor value = minibatch.value.cpu().clone();
  const Tensor seen = value.narrow(0, 0, minibatch.steps());
  seen.copy_(torch::where(minibatch.filled.to(torch::kBool), now.value, seen));
  const Advantages result = vtrace(log_rho.contiguous(),
                                   {.reward = minibatch.reward.contiguous(),
                                    .terminated = minibatch.terminated.contiguous(),
                                    .truncated = minibatch.truncated.contiguous(),
                                    .value = value.contiguous(),
                                    .final_value = minibatch.final_value.contiguous(),
                                    .valid = minibatch.host_valid,
                                    .value_valid = minibatch.value_valid},
                                   {.gamma = config_.optimisation.gamma,
                                    .rho_clip = config_.on_policy.vtrace_rho,
                                    .c_clip = config_.on_policy.vtrace_c,
                                    .legacy_timeouts = config_.optimisation.legacy_timeouts});
  reported_advantage_ = ranks().gather(result.advantage, 1);
  reported_acting_ = ranks().gather(minibatch.host_acting, 1);
  minibatch.advantage = result.advantage.to(device_);
  minibatch.target = result.target.to(device_);
}

bool Ippo::accumulate_gradient(RolloutBatch& minibatch, const UpdateContext& context, TermValues& terms) {
  const Phase whole = phase();
  minibatch = to_device(minibatch, device_);
  whole.prepare(minibatch);
  return accumulate(minibatch, whole, context, terms);
}

}  // namespace comrad::learn
