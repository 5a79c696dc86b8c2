// IPPO: every agent learns by PPO as if it were alone. One network is shared by all agents, sees one agent's
// frames and predicts that agent's own value.
//
//   ratio  = clamp(exp(log pi - log mu), 0.05, 20)
//   loss   = - mean min(ratio A, clip(ratio, 1/(1+eps), 1+eps) A)             eps = ppo_clip_ratio
//            + value_loss_coeff mean max((V-R)^2, (V_old + clamp(V-V_old, +-ppo_clip_value) - R)^2)
//            + exploration_loss_coeff mean symmetric_kl(pi, uniform) + kl_loss_coeff mean KL(pi, mu)
//
// over valid samples; A from GAE with a true bootstrap at time-outs, standardised over the minibatch; V and R
// in normalised units. Back-propagation through time runs over the whole rollout. Source: de Witt et al.
// 2020, arXiv:2011.09533; Schulman et al. 2017, arXiv:1707.06347; training spec 2.1, 2.2.
#pragma once

#include <torch/types.h>

#include "learner/algorithms/adam_optimizer.h"
#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/lr_schedule.h"
#include "learner/batch/normalizer.h"
#include "policy_workers/policy/policy_net.h"

namespace comrad::learn {

class Ippo : public Algorithm {
 public:
  Ippo(const RunConfig& config, const EnvShape& env, torch::Device device);

  Expected<UpdateStats> update(Minibatch& batch, const UpdateContext& context) override;
  PolicyVersion version() const override { return version_; }
  int64_t parameter_count() const override { return net_.parameter_count(); }
  int64_t weights_bytes() const override { return net_.weights_bytes(); }
  void write_weights(std::span<std::byte> out) const override { net_.write_weights(out); }
  void save(StateDict& state) const override;
  Status load(const StateDict& state) override;

  /// Fills `advantage` and `target` of a lag-filtered batch: GAE on denormalised values, then the returns
  /// enter the running statistics and become normalised targets.
  void prepare_targets(Minibatch& batch);

  /// Sums that one minibatch collects over its micro-batches; means over valid samples unless said otherwise.
  struct LossSums {
    double policy = 0, value = 0, exploration = 0, kl_penalty = 0;
    double kl = 0, kl_max = 0, entropy = 0, predicted_value = 0, value_delta = 0, value_delta_max = 0;
    double ratio = 0, ratio_min = kRatioUnset, ratio_max = 0, clipped = 0, log_prob_max = 0;
    static constexpr double kRatioUnset = 1e30;
    double actor() const { return policy + exploration + kl_penalty; }
    double total() const { return actor() + value; }
  };
  /// Adds the gradient of the loss over a whole minibatch to the parameters' .grad, micro-batch by
  /// micro-batch. `minibatch.advantage` is standardised here. False when keep_going() said no.
  bool accumulate_gradient(Minibatch& minibatch, const UpdateContext& context, LossSums& sums);

  const policy::PolicyNet& net() const { return net_; }
  const ReturnNormalizer& return_normalizer() const { return returns_; }

 protected:
  /// What checkpoints call it.
  virtual const char* name() const { return "ippo"; }

 private:
  enum class StepResult { kTrained, kSkipped, kAbandoned };
  StepResult train_minibatch(Minibatch& minibatch, const UpdateContext& context, UpdateStats& stats,
                             LossSums& sums);
  void report(const Minibatch& batch, const LossSums& sums, UpdateStats& stats) const;

  RunConfig config_;
  EnvShape env_;
  torch::Device device_;
  policy::PolicyNet net_;
  AdamOptimizer optimizer_;
  LrSchedule schedule_;
  ReturnNormalizer returns_;
  PolicyVersion version_ = 0;
  int64_t updates_ = 0;  ///< batches seen; keys the shuffling
  int64_t skipped_in_a_row_ = 0;
  double last_grad_norm_ = 0;
  double last_learning_rate_ = 0;  ///< after the valid fraction
};

}  // namespace comrad::learn
