#include "learner/losses/td_loss.h"

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/utilities.h"

namespace comrad::learn {
namespace {

constexpr double kNone = 1e30;  // what an extreme of no sample is, with its sign

}  // namespace

LossTerms td_loss(const SampleLoss& sample, const Tensor& valid, const Tensor& q, const Tensor& q_unit,
                  const ReplayBatch& batch, std::span<const Tensor> scalars, const TdLossOptions& options) {
  LossTerms terms;
  const Tensor &samples = scalars[0], &sigma = scalars[1], &worlds = scalars[2];
  const Tensor counted = valid.to(torch::kFloat32), share = counted / samples;
  const int64_t samples_of_world = counted.size(1) / batch.world_count;
  const Tensor importance = batch.weight.unsqueeze(1).expand({-1, samples_of_world}).reshape({1, -1});
  terms.add("td_loss", (sample.loss * share * importance).sum());
  if (sample.regularizer.defined()) terms.add("attend_mag_regs", (sample.regularizer * share).sum());

  torch::NoGradGuard no_grad;
  const Tensor counts = counted.to(torch::kBool);
  const bool is_joint = options.is_joint;
  terms.mean(is_joint ? "q_tot_mean" : "dqn_q_mean", sample.predicted, share);
  terms.max(is_joint ? "q_tot_max" : "dqn_q_max", sample.predicted, counts, -kNone);
  if (!is_joint) terms.min("dqn_q_min", sample.predicted, counts, kNone);
  terms.mean(is_joint ? "target_q_tot_mean" : "dqn_target_q_mean", sample.target, share);
  terms.max("target_q_max", sample.target, counts, -kNone);
  terms.mean("target_mean_square", sample.target.square(), share);
  terms.mean(is_joint ? "td_error_mean" : "dqn_td_error_mean", sample.error, share);
  if (sample.unclamped.defined()) {
    terms.mean("target_before_clamp", sample.unclamped, share);
    terms.mean("targets_clipped_fraction", sample.target.ne(sample.unclamped).to(torch::kFloat32), share);
  }
  if (sample.mixer_gain.defined()) terms.mean("mixer_gain", sample.mixer_gain, share);
  if (sample.state_rms.defined()) terms.mean("mixer_state_rms", sample.state_rms, share);
  if (sample.head_entropy.defined()) terms.mean("head_entropy_mean", sample.head_entropy, share);

  // Of every agent's decision, whatever a sample is.
  const Tensor utility = policy::chosen_utility(q, batch.action, batch.shape.env).detach() * q_unit;
  const Tensor taken = batch.valid.to(torch::kBool);
  const Tensor of_row = batch.valid.to(torch::kFloat32) / samples *
                        (static_cast<double>(counted.size(1)) / static_cast<double>(batch.rows()));
  terms.mean("agent_qs_mean", utility, of_row);
  terms.max("agent_qs_max", utility, taken, -kNone);
  terms.min("agent_qs_min", utility, taken, kNone);
  terms.sum("q_std_across_actions",
            q.detach().std(-1, /*unbiased=*/false).mean() * q_unit * batch.world_count / worlds);
  terms.mean("done_ratio", batch.terminated.to(torch::kFloat32), of_row);
  terms.mean("timeout_ratio", batch.truncated.to(torch::kFloat32), of_row);

  const Tensor of_worlds = counted.view({counted.size(0), batch.world_count, samples_of_world});
  const Tensor errors = sample.error.view_as(of_worlds) * of_worlds / sigma;
  terms.kept = errors.sum(2).sum(0) / of_worlds.sum(2).sum(0).clamp_min(1.0);
  if (options.sequence_share > 0 && counted.size(0) > 1)
    terms.kept = options.sequence_share * errors.amax({0, 2}) + (1 - options.sequence_share) * terms.kept;
  return terms;
}

}  // namespace comrad::learn
