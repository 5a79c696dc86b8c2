// What the on-policy algorithms share: lag filter, input statistics, advantages and normalised returns, the
// loop over epochs and minibatches, reports and checkpoints. The loss is losses/ppo_loss.h's, the step step/step_runner.h's; Ippo,
// Mappo and Happo say which networks an optimizer trains on which rows, in which order. Back-propagation
// through time runs over the whole rollout. Stage: update.
#pragma once

#include <torch/types.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/batch/normalizer.h"
#include "learner/losses/loss_terms.h"
#include "learner/losses/ppo_loss.h"
#include "learner/schedules/lr_schedule.h"
#include "learner/step/launched_steps.h"
#include "learner/step/step_runner.h"
#include "policy_workers/network/actor_critic.h"

namespace comrad::learn {

class OnPolicy : public OnPolicyAlgorithm {
 public:
  PolicyVersion version() const override { return runner_.version(); }
  int64_t parameter_count() const override { return net_.parameter_count(); }
  std::vector<Tensor> weight_tensors() const override { return net_.weight_tensors(); }
  int64_t weights_bytes() const override { return net_.weights_bytes(); }
  std::vector<std::byte> weights() const override { return net_.weights(); }
  void append_diagnostics(NamedNumbers& values) const override;
  Status learn_with(RankGroup& ranks) override;
  void settle() override { launched_.settle(); }
  void save(StateDict& state) const override;
  Status load(const StateDict& state) override;

  /// Fills `advantage` and `target` of a lag-filtered batch: GAE on denormalised values with a true bootstrap
  /// at time-outs, then the returns enter the running statistics and become normalised targets.
  void prepare_targets(RolloutBatch& batch);

  const policy::ActorCritic& net() const { return net_; }
  const ReturnNormalizer& return_normalizer() const { return returns_; }

 protected:
  OnPolicy(const RunConfig& config, const EnvShape& env, torch::Device device);

  /// The networks' outputs for rows of a minibatch; undefined logits or values leave their losses out.
  using Forward = std::function<policy::SequenceOutput(const policy::SequenceInput&)>;

  /// Some epochs over some rows with one optimizer.
  struct Phase {
    AdamOptimizer& optimizer;
    Forward forward;
    bool trains_policy = true;  ///< KL and actor loss say when to stop
    bool trains_value = true;   ///< a minibatch without an acting sample is trained on, too
    uint64_t shuffle_key = 0;   ///< differs between the phases of one update
    /// Called with every minibatch before its gradient; may be empty.
    std::function<void(RolloutBatch&)> prepare = {};
    /// Set to log pi(a|o) [T, rows] of the first minibatch before the first step.
    Tensor* first_log_prob = nullptr;
  };
  enum class PhaseEnd { kDone, kStopped, kAbandoned };

  /// The loss over a micro-batch: ppo_loss(). Override it to add a term or a metric.
  virtual LossTerms loss(const policy::SequenceOutput& output, const RolloutBatch& rows,
                         const PpoScalars& scalars) const;

  /// Moves the schedule, filters by lag, updates input statistics. False when nothing valid is left. Errors:
  /// kBadInput where that was so in too many batches in a row.
  Expected<bool> begin_update(RolloutBatch& batch, const UpdateContext& context, UpdateStats& stats);
  /// num_epochs x num_batches_per_epoch optimizer steps on a batch, moved to the device where to_device() did not; `terms` are those
  /// of the last one taken. A step's loss terms are read once, when the phase is over, or, where no report is wanted, in a phase
  /// after it. Settings may need them earlier: a rate or an early stop that follows the KL needs it after every step, epochs need the
  /// loss of the one before. kStopped when begin_step, kAbandoned when keep_going returned false. Errors: kBadInput after too many
  /// steps in a row that were not finite.
  Expected<PhaseEnd> train_phase(const RolloutBatch& batch, const Phase& phase, const UpdateContext& context,
                                 UpdateStats& stats, TermValues& terms);
  /// Adds the gradient of the loss over a whole minibatch to the parameters' .grad, with
  /// `minibatch.advantage` as it is. False once keep_going() returned false.
  bool accumulate(const RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                  TermValues& terms);

  /// What the networks say of a batch now, without gradient, on the batch's device.
  struct Evaluation {
    Tensor log_prob;  ///< f32 [T, R] of the actions taken; undefined without logits
    Tensor value;     ///< f32 [T, R]; undefined without values
  };
  Evaluation evaluate(const RolloutBatch& batch, const Phase& phase);

  /// `more`: further numbers, one value a tensor, to be read from the device with the others.
  void report(const RolloutBatch& batch, const TermValues& terms, UpdateStats& stats,
              const std::vector<std::pair<std::string, Tensor>>& more = {}) const;
  RankGroup& ranks() const { return runner_.ranks(); }

  /// The advantages of a minibatch of all ranks with mean 0 and deviation 1 over `acting`; this rank's part of them.
  Tensor standardized(const Tensor& advantage, const Tensor& acting);

  RunConfig config_;
  EnvShape env_;
  torch::Device device_;
  policy::ActorCritic net_;
  /// With the prefix of their keys in checkpoints; derived classes make them.
  std::vector<std::pair<std::string, AdamOptimizer>> optimizers_;
  LrSchedule schedule_;
  ReturnNormalizer returns_;
  StepRunner runner_;
  int64_t updates_ = 0;    ///< batches seen; keys the shuffling
  double env_frames_ = 0;  ///< of the run before the newest batch, where schedules stand
  double last_grad_norm_ = 0;
  Tensor reported_advantage_, reported_acting_;          ///< before standardisation
  double explained_variance_ = 0, targets_clipped_ = 0;  ///< of the newest batch

 private:
  /// A minibatch, or a whole batch, and the phase that reads it.
  class Input;
  /// Samples of a minibatch of all ranks.
  struct SampleTotals {
    double valid = 0, acting = 0, places = 0;
  };
  /// PpoScalars of this moment.
  std::vector<double> scalars(const SampleTotals& totals) const;
  enum class StepResult { kLaunched, kSkipped, kAbandoned, kKlReached };
  SampleTotals totals_of(const RolloutBatch& minibatch);
  /// A batch in parts, as views: whole worlds, at least one, and no more than lets every thread have a part.
  std::vector<RolloutBatch> micro_batches(const RolloutBatch& batch) const;
  Evaluation evaluate_now(const RolloutBatch& batch, const Forward& forward) const;
  StepResult train_minibatch(RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                             bool is_first, UpdateStats& stats);

  LaunchedSteps launched_;
};

}  // namespace comrad::learn
